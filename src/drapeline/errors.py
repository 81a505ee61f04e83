"""The exception raised for unusable input."""


class InputError(ValueError):
    """A file or value supplied by the user is unusable.

    The message is a single sentence naming the file, the offending value and what was expected;
    rules print it on the terminal without a traceback.
    """
