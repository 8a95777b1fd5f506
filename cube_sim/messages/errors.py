"""The one exception that leaves the decoding half of this room."""


class MessageError(ValueError):
    """Says in one sentence why some bytes are not the message that they should be."""
