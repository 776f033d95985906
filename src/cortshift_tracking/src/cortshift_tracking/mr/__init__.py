"""The preoperative MR."""
from cortshift_tracking.mr.reader import load_volume

__all__ = ['load_volume']
