"""Training that all models share."""
