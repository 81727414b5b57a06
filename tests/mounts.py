"""Folders that a test mounts for a program that it starts, and that nothing else sees."""

import shutil
import subprocess

import pytest


def with_mount(mount: str) -> list[str]:
    """What stands before a command that is to see a mount, a line of the shell; skips where this is not allowed."""
    inside = ["unshare", "--map-root-user", "--mount", "sh", "-c", f'{mount} && exec "$@"', "sh"]
    if shutil.which("unshare") is None or subprocess.run([*inside, "true"], capture_output=True).returncode:
        pytest.skip("this machine does not let a test mount anything for a program")
    return inside
