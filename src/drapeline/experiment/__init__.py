"""The experiment: its settings, its samples, and which code each rule runs."""
