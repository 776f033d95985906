#!/bin/sh
# properties = {properties}
# A job that is queued again because its node failed may have got as far as its result: that stands.
if [ "${{SLURM_RESTART_COUNT:-0}}" -gt 0 ] && [ -e "$CASE_RESULT" ]; then exit 0; fi
{exec_job}
