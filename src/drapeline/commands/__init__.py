"""What the command `drapeline` does."""
