"""Only regular files are read: a pipe or device among files of others would keep a program waiting for ever."""

import errno
import stat
from pathlib import Path


def regular(path: Path) -> Path:
    """The path, to be opened; also that of a missing file, which whoever opens it has words for.

    Raises:
        OSError: if it is a pipe, socket or device, or cannot be looked at.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return path
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise OSError(errno.EINVAL, "is a pipe or a device, not a file", str(path))
    return path
