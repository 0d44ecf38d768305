"""What a session refuses."""


class RefusedError(ValueError):
    """What the outside sent cannot be used; the text says why, and nothing has changed."""
