"""Motions: readers of motion-capture files, retargeting to the 24 SMPL joints, floor, splits."""
