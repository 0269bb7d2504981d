"""The exceptions of Seeing by Moving: one root, a few named kinds.

Every message says what was given, what was expected and what to do.
"""


class SbmError(Exception):
    """Root of all errors that a user of this project may want to catch.

    Command-line programs print the message of an ``SbmError`` on one line and exit with code 2.

    Example:
        >>> from pathlib import Path
        >>> from labeling import find_episodes
        >>> try:
        ...     find_episodes(Path("no/such/folder"))
        ... except SbmError as error:
        ...     print(error)
        no/such/folder: no such folder; give an episode or a folder of episodes
    """


class EpisodeFormatError(SbmError, ValueError):
    """An episode on disk is malformed; the message names the file and the field."""


class LabelFormatError(SbmError, ValueError):
    """A label set on disk is malformed; the message names the file and the field."""


class UsageError(SbmError, ValueError):
    """A command line or function argument does not make sense."""


class MissingAssetsError(SbmError, FileNotFoundError):
    """A furniture library that a world needs is not installed."""
