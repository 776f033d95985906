"""What is watched while the graph runs: gaps of streams, memory of nodes, errors."""
import re
import statistics
import threading
import time
import xmlrpc.client

import rosgraph
import rospy
from rosgraph_msgs.msg import Log

WARM = 60.0       # s after which a node's memory is taken as that of its start
AROUND = 60.0     # s: the middle of what is measured in so long counts, since memory comes and goes with each capture and shift
AFTER = 20.0      # s after a fault in which errors are put down to it
STEADY = 600.0    # s after which a node's memory is not to grow any more


class Gaps:
    """Longest time between two things of one kind; those that a fault lies in are told apart."""

    def __init__(self):
        self._last, self._count, self._gaps, self._lock = {}, {}, {}, threading.Lock()

    def tick(self, name, now=None):
        now = time.monotonic() if now is None else now
        with self._lock:
            last = self._last.get(name)
            self._last[name], self._count[name] = now, self._count.get(name, 0) + 1
            if last is not None:
                self._gaps.setdefault(name, []).append((now - last, last, now))

    def watch(self, topic):
        rospy.Subscriber(topic, rospy.AnyMsg, lambda _: self.tick(topic), queue_size=50)

    def count(self, name):
        return self._count.get(name, 0)

    def since(self, name, began):
        """Whether something came after a time."""
        return self._last.get(name, 0) > began

    def rows(self, faults):
        """(name, count, longest gap [s], longest gap that no fault lies in [s])."""
        out = []
        for name, gaps in sorted(self._gaps.items()):
            quiet = [length for length, begin, end in gaps if not any(begin - AFTER < fault.began < end for fault in faults)]
            out.append((name, self._count[name], max(gap[0] for gap in gaps), max(quiet, default=float('nan'))))
        return out


def pid_of(node):
    """Of a node by its name; None where nobody answers by that name."""
    try:
        address = rosgraph.Master('/soak').lookupNode('/' + node)
        return xmlrpc.client.ServerProxy(address).getPid('/soak')[2]
    except (rosgraph.MasterException, OSError, xmlrpc.client.Error):
        return None


def resident(pid):
    """Memory of a process [MB], or None."""
    try:
        with open(f'/proc/{pid}/status', encoding='ascii') as file:
            return int(re.search(r'VmRSS:\s+(\d+) kB', file.read()).group(1)) / 1024
    except (OSError, AttributeError):
        return None


class Memory:
    """Memory of each node's processes over time."""

    def __init__(self, nodes):
        self._samples = {node: {} for node in nodes}

    def sample(self):
        for node, processes in self._samples.items():
            pid = pid_of(node)
            size = pid and resident(pid)
            if size:
                processes.setdefault(pid, []).append((time.monotonic(), size))

    @staticmethod
    def _typical(life, since):
        """[MB] of the AROUND seconds after a time of its life [s]."""
        began = life[0][0] + since
        return statistics.median(size for at, size in life if began <= at <= began + AROUND)

    def rows(self):
        """(node, processes, seconds of the one that lived longest, MB at its start, at its end, growth after STEADY [%] or None)."""
        out = []
        for node, processes in self._samples.items():
            lives = [samples for samples in processes.values() if len(samples) > 1]
            if not lives:
                out.append((node, len(processes), 0, float('nan'), float('nan'), None))
                continue
            life = max(lives, key=lambda samples: samples[-1][0] - samples[0][0])
            seconds = life[-1][0] - life[0][0]
            start, end = self._typical(life, min(WARM, seconds / 2)), self._typical(life, max(0, seconds - AROUND))
            steady = self._typical(life, STEADY) if seconds > STEADY + AROUND else None
            out.append((node, len(processes), seconds, start, end, steady and 100 * (end / steady - 1)))
        return out


class Errors:
    """Messages of level error and worse on /rosout, alike ones together, and whether a fault lies before each."""

    def __init__(self, faults):
        self._faults, self._told, self._lock = faults, {}, threading.Lock()
        rospy.Subscriber('/rosout', Log, self._keep, queue_size=200)

    def _keep(self, log):
        if log.level < Log.ERROR or log.name == rospy.get_name():
            return
        now = time.monotonic()
        before = next((fault for fault in reversed(self._faults) if fault.began - 1 < now < fault.ended + AFTER), None)
        key = log.name, re.sub(r'[-\d.]+', '#', log.msg)[:200]
        with self._lock:
            told = self._told.setdefault(key, {'count': 0, 'unexplained': 0, 'example': log.msg, 'after': set()})
            told['count'] += 1
            told['unexplained'] += before is None
            if before:
                told['after'].add(before.kind)

    def rows(self):
        with self._lock:
            return [(name, told['example'], told['count'], told['unexplained'], ', '.join(sorted(told['after'])))
                    for (name, _), told in sorted(self._told.items())]
