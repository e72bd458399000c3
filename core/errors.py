"""The one exception that means "the user gave us something we cannot use"."""


class InputError(ValueError):
    """Bad input: one sentence that names the file or field, the problem and the fix.

    The command line prints the sentence on stderr and exits with code 2; nothing is half-written.
    """
