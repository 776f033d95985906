"""What shift_tracker says of itself in its diagnostics; see ros/tracker/health.hpp."""

TRACKER_STATE = 'shift_tracker: state'  # name of the status
NOT_KNOWN = 'not known'                 # its value `gravity`, where none is
