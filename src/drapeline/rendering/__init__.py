"""Cameras, rays and pictures."""
