"""The surgeon's console: keys in a terminal and the same as a page for a browser on this machine.

    rosrun cortshift_tracking console [--port N] [--token-file FILE] [--no-page] [--no-terminal]

The page asks for the token in FILE, or in the file that the parameter console_page/token_file names.

Exit status: 0 ended, 1 failed, 2 bad usage."""
import argparse
import sys

import rospy

from cortshift_tracking.console.desk import Desk
from cortshift_tracking.console.page import PageServer, TokenError, token_of
from cortshift_tracking.console.terminal import Terminal

PORT = 8095


def arguments(words):
    parser = argparse.ArgumentParser(prog='console', description=__doc__.split('\n')[0])
    parser.add_argument('--port', type=int, default=PORT, help=f'of the page on 127.0.0.1; 0 takes a free one (default {PORT})')
    parser.add_argument('--token-file', default='', help='file with a token that the page asks for; only its owner may read it')
    parser.add_argument('--no-page', action='store_true', help='no page')
    parser.add_argument('--no-terminal', action='store_true', help='no keys: the page alone, until stopped')
    values = parser.parse_args(words)
    if values.no_page and values.no_terminal:
        parser.error('neither page nor terminal leaves nothing to do')
    if not 0 <= values.port <= 65535:
        parser.error('--port is 0 ... 65535')
    return values


def main():
    values = arguments(rospy.myargv()[1:])
    # Alone in its terminal: log messages would tear the status line.
    rospy.init_node('console', anonymous=True, log_level=rospy.FATAL)
    desk = Desk()
    page = None
    if not values.no_page:
        try:
            page = PageServer(desk, values.port, token_of(values.token_file or rospy.get_param('console_page/token_file', '')))
        except TokenError as error:
            print(f'console: {error}', file=sys.stderr)
            return 1
        except OSError as error:
            print(f'console: no page at port {values.port}: {error}; give another --port, or --no-page', file=sys.stderr)
            return 1
        print(f'page: {page.address}', flush=True)
    try:
        if values.no_terminal:
            rospy.spin()
        else:
            Terminal(desk).run()
    except KeyboardInterrupt:
        pass
    finally:
        if page:
            page.stop()
    return 0
