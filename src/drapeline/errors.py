"""The one exception that a user's input may raise."""


class InputError(ValueError):
    """A file or value from outside is unusable.

    The message is one sentence that names the file, the value found and what was expected;
    rule logs and the command line print it without a traceback.
    """
