"""What the command line hands on where no option is given."""

from milkglass.viewer.commands.options import FLAGS

NO_OPTIONS = dict.fromkeys(("model", "scene", "set", "light", *(flag.parameter for flag in FLAGS)))
