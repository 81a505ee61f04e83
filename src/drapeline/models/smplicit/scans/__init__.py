"""Garments in segmented scans."""
