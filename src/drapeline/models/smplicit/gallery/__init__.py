"""The gallery of a trained model's codes."""
