"""Proof and pictures of cortshift: probe, preoperative MR, validation tables and the case report.

Cores are numpy on plain arrays; ROS stands at the edge (modules that import rospy or rosbag say so). Metres everywhere;
names that hold millimetres say `_mm`.
"""
