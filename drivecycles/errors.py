"""The one error that this package raises for input a user can put right."""


class CycleError(ValueError):
    """A drive cycle is missing, unreadable or physically impossible; the message says what to do."""
