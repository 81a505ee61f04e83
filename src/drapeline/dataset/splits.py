"""Splits of samples for training, validation and testing."""

SPLITS = ("train", "val", "test")
