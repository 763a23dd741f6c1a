"""What a plain file cannot do for python programs in a simulated brick's private view.

/dev/fb0 is a file there: the two ioctls by which a program learns the screen's layout are answered
from /sys/class/graphics/fb0. Input devices are files of FUSE: evdev looks for character devices,
and finds these.
"""
import fcntl
import importlib.machinery
import importlib.util
import os
import struct
import sys

_FBIOGET_VSCREENINFO, _FBIOGET_FSCREENINFO = 0x4600, 0x4602
_SCREEN = "/dev/fb0"
_ABOUT = "/sys/class/graphics/fb0/"
_ioctl = fcntl.ioctl


def _about(name):
    with open(_ABOUT + name) as file:
        return [int(number) for number in file.read().split(",")]


def _answer(request):
    """The bytes of fb_fix_screeninfo or fb_var_screeninfo (linux/fb.h)."""
    width, height = _about("virtual_size")
    (bits,), (stride,) = _about("bits_per_pixel"), _about("stride")
    if request == _FBIOGET_FSCREENINFO:
        visual = 2 if bits > 1 else 1
        memory = (0, stride * height, 0, 0, visual, 1, 1, 0, stride)
        return struct.pack("@16sLIIIIHHHILII3H", b"", *memory, 0, 0, 0, 0, 0, 0)
    rgb = [(16, 8, 0), (8, 8, 0), (0, 8, 0)] if bits == 32 else [(0, bits, 0)] * 3
    numbers = [width, height, width, height, 0, 0, bits, 0]
    numbers += [part for colour in rgb + [(0, 0, 0)] for part in colour] + [0, 0, 37, 27]
    return struct.pack("@40I", *(numbers + [0] * 40)[:40])


def _is_screen(file):
    number = file if isinstance(file, int) else file.fileno()
    try:
        return os.path.samestat(os.fstat(number), os.stat(_SCREEN))
    except OSError:
        return False


def ioctl(file, request, arg=0, mutate_flag=True):
    if request not in (_FBIOGET_VSCREENINFO, _FBIOGET_FSCREENINFO) or not _is_screen(file):
        return _ioctl(file, request, arg, mutate_flag)
    answer = _answer(request)
    if isinstance(arg, bytes):
        return answer[: len(arg)]
    place = memoryview(arg).cast("B")
    length = min(len(place), len(answer))
    place[:length] = answer[:length]
    return 0


fcntl.ioctl = ioctl


class _Evdev:
    """Has evdev take a file that answers an input device's ioctls for one."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name != "evdev.util":
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        if spec is not None:
            load = spec.loader.exec_module

            def exec_module(module):
                load(module)
                module.is_device = lambda fn, *_, **__: os.access(fn, os.R_OK | os.W_OK)

            spec.loader.exec_module = exec_module
        return spec


sys.meta_path.insert(0, _Evdev)

# The machine's own sitecustomize, which this one lies before.
_own = os.path.dirname(os.path.abspath(__file__))
_others = [folder for folder in sys.path if os.path.abspath(folder or ".") != _own]
_spec = importlib.machinery.PathFinder.find_spec("sitecustomize", _others)
if _spec is not None:
    _spec.loader.exec_module(importlib.util.module_from_spec(_spec))
