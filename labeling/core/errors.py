"""The exceptions of Seeing by Moving: one root, a few named kinds.

Every message says what was given, what was expected and what to do.
"""


class SbmError(Exception):
    """Root of all errors that a user of this project may want to catch.

    Command-line programs print the message of an ``SbmError`` on one line and exit with code 2.
    """


class EpisodeFormatError(SbmError, ValueError):
    """An episode on disk is malformed; the message names the file and the field."""


class LabelFormatError(SbmError, ValueError):
    """A label set on disk is malformed; the message names the file and the field."""


class UsageError(SbmError, ValueError):
    """A command line or function argument does not make sense."""


class MissingAssetsError(SbmError, FileNotFoundError):
    """A furniture library that a world needs is not installed."""
