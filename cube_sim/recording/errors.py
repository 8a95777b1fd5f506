"""The one exception that leaves this package."""


class RecordingError(Exception):
    """Says in one sentence what is wrong with a recording and what would be right."""


def reason(error: BaseException) -> str:
    """Return the operating system's words for `error`, without number and path."""
    return getattr(error, 'strerror', None) or str(error) or type(error).__name__
