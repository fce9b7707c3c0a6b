"""flexid: physical parameters of flexible-joint drives from their motion, without accelerations."""

__version__ = "0.1.0"
