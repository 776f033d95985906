#!/usr/bin/python3
"""From your own program: capture a stage now and tell how far the brain has moved since another.

    first_shift.py FROM TO      FROM: key of an earlier stage; TO: key for the one that is captured now
"""
import sys

import rospy
from cortshift_msgs.srv import CaptureStage, ComputeShift


def main(from_key, to_key):
    rospy.init_node('first_shift', anonymous=True)
    capture = rospy.ServiceProxy('shift_tracker/capture_stage', CaptureStage)
    compute = rospy.ServiceProxy('shift_tracker/compute_shift', ComputeShift)
    capture.wait_for_service(30)
    for call in (lambda: capture(key=to_key, note='first_shift.py'), lambda: compute(from_key=from_key, to_key=to_key)):
        answer = call()
        if not answer.success:   # a refusal says what is wrong and what to do
            print(f'refused: {answer.message}', file=sys.stderr)
            return 1
    summary = answer.summary
    print(f'{1000 * summary.magnitude_mean:.2f} mm over {100 * summary.overlap:.0f} %')   # messages are in metres
    for warning in summary.warnings:
        print(f'warning: {warning}')
    return 0


if __name__ == '__main__':
    words = rospy.myargv()[1:]
    if words == ['--help']:
        print(__doc__)
    elif len(words) != 2:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    else:
        sys.exit(main(*words))
