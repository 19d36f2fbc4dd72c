"""The one error that means "the command was used wrongly": exit code 2, and its message names the remedy."""


class UsageError(Exception):
    """Raised by any command before it has done work; the message is shown to the user as it is."""
