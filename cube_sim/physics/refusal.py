"""The one exception that leaves this room."""


class PhysicsError(ValueError):
    """What the physics refuses: a setting, a throw, a call; the message says what is right."""
