"""Helpers that several tests share stand in support and its folders."""
import os
import sys

SUPPORT = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'support')
sys.path[:0] = [SUPPORT, os.path.join(SUPPORT, 'case'), os.path.join(SUPPORT, 'mr'), os.path.join(SUPPORT, 'project'),
                os.path.join(SUPPORT, 'recording')]
