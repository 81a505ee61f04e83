"""What networks learn from: arrays, collected once and mapped. No torch here."""
