"""What typer finds wrong with a command line, as one sentence."""

import typer


def usage_sentence(error: typer.TyperException) -> str:
    """Return what typer found wrong as one sentence, with the nearest option where it knows one."""
    near = getattr(error, "possibilities", None)
    text = error.message if near else error.format_message()
    text = text[:1].lower() + text[1:].rstrip(". ")
    if near:
        return f"{text}; did you mean {' or '.join(sorted(near))}?"
    if text.startswith("no such command") and "Did you mean" not in text:
        return f"{text}; to show a model, write `milkglass view MODEL`"
    return text
