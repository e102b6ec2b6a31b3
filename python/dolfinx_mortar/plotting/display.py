# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Where VTK can draw."""

from __future__ import annotations

import atexit
import ctypes
import os
import shutil
import subprocess
import sys
import warnings


def make_display() -> bool:
    """Make sure that VTK can draw; on a machine without a screen by a virtual one."""
    if not sys.platform.startswith("linux") or os.environ.get("DISPLAY"):
        return True
    from vtkmodules.vtkCommonCore import vtkVersion

    if (vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()) >= (9, 5):
        return True  # falls back to EGL or OSMesa by itself
    if shutil.which("Xvfb") is None:
        warnings.warn("no picture: there is no screen, and Xvfb is not installed", stacklevel=3)
        return False

    def end_with_parent() -> None:
        # Also when Python is killed and cannot clean up: prctl(PR_SET_PDEATHSIG, SIGTERM)
        ctypes.CDLL(None).prctl(1, 15)

    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x1024x24", "-nolisten", "tcp"],
        pass_fds=(write,),
        preexec_fn=end_with_parent,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as pipe:
        number = pipe.readline().strip()
    if not number:
        warnings.warn("no picture: there is no screen, and Xvfb does not start", stacklevel=3)
        return False
    atexit.register(server.terminate)
    os.environ["DISPLAY"] = f":{number}"
    return True
