"""The models and their training; the only user of torch but for what bakes bodies."""
