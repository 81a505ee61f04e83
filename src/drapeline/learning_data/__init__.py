"""Arrays that networks learn from, collected once and mapped. No torch here."""
