"""The only part that talks to Blender."""
