"""Processes of this machine."""

import ctypes
import os
import sys


def is_running(number: int) -> bool:
    """Tell whether there is a process of a number."""
    if sys.platform == "win32":
        limited_information = 0x1000
        handle = ctypes.windll.kernel32.OpenProcess(limited_information, 0, number)
        ctypes.windll.kernel32.CloseHandle(handle)
        return bool(handle)
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
