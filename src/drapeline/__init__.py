"""drapeline: from motion capture to simulated, CLOTH3D-format clothed humans."""

__version__ = "0.1.0"
