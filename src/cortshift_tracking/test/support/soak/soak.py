#!/usr/bin/python3
"""What script/soak runs; its help is there."""
import argparse
import contextlib
import glob
import math
import os
import pathlib
import random
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import zlib

import yaml

ROOT = pathlib.Path(__file__).resolve().parents[5]
SUPPORT = ROOT / 'src/cortshift_tracking/test/support'
sys.path[:0] = [str(SUPPORT), str(SUPPORT / 'soak')]
from programs import free_ports  # noqa: E402
START = 90.0          # s for the graph to be there
TOPICS = ('/stereo/left/image_raw', '/surface/points', '/microscope/pose', '/tf', '/shift/field', '/diagnostics')
RECORDED = ('/stereo/left/image_raw', '/tf')
DROPOUTS = 0.03       # of the tracker, per second
DISK_FOR = 15         # minutes that 1 GB of the case's disk is enough for
QUIET = 1500.0        # s without faults at the end of a long run: growth of memory shows only in nodes that live
LONG = 2400.0         # s of a long run
LAUNCH = '''<launch>
  <include file="{root}/launch/compute_pc.launch"><arg name="case_folder" value="{folder}/case"/><arg name="page" value="{page}"/></include>
  <include file="{root}/launch/capture_pc.launch">
    <arg name="phantom" value="{phantom}"/><arg name="site" value="{folder}/site.yaml"/><arg name="preflight" value="false"/>
  </include>
  <group ns="shift_tracker"><rosparam command="load" file="{support}/coarse_config/shift_tracker.yaml"/></group>
  <group ns="surface_reconstruction"><rosparam command="load" file="{support}/coarse_config/surface_reconstruction.yaml"/></group>
  <param name="/igtl_bridge/listen_port" value="{igtl}"/>
  <param name="/stereo_driver/tracker_dropouts" value="{dropouts}"/><param name="/stereo_driver/tracker_dropout_length" value="1.0"/>
</launch>
'''
CASE = SUPPORT / 'two_stages.yaml'


def options_of(arguments):
    parser = argparse.ArgumentParser(prog='script/soak')
    parser.add_argument('minutes', type=float, metavar='MINUTES')
    parser.add_argument('--faults', action='store_true')
    parser.add_argument('--kills', type=int, default=0)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--output')
    parser.add_argument('--report')
    parser.add_argument('--cameras', action='store_true')
    parser.add_argument('--clock', action='store_true')
    parser.add_argument('--own-mounts', action='store_true')
    options = parser.parse_args(arguments)
    if not 0 < options.minutes <= 10000:
        parser.error('MINUTES must be above 0')
    if options.clock:
        from soak_faults import set_clock
        try:
            set_clock(0)
        except PermissionError:
            parser.error('--clock sets the clock of this machine, which needs the right to')
    return options


def end(process, number=signal.SIGINT, seconds=60):
    if process.poll() is None:
        process.send_signal(number)
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


class Graph:
    """Master and nodes, in a folder, until it is ended."""

    def __init__(self, folder, options, cleanup):
        self.folder, (self.igtl, self.page, self._port) = folder, free_ports(3)
        self.case, self.own_clock = folder / 'case', options.clock
        self.case.mkdir()
        self.own_disk = options.own_mounts and subprocess.run(
            ['mount', '-t', 'tmpfs', '-o', f'size={max(1, math.ceil(options.minutes / DISK_FOR))}g', 'none', self.case], check=False).returncode == 0
        if self.own_disk:
            cleanup.callback(subprocess.run, ['umount', '-l', self.case], check=False)
        os.environ.update(ROS_MASTER_URI=f'http://localhost:{self._port}', ROS_HOSTNAME='localhost', ROS_HOME=str(folder / 'home'))
        os.environ.pop('ROS_LOG_DIR', None)
        launch = folder / 'soak.launch'
        dropouts = DROPOUTS if options.faults else 0.0
        recordings = {'folder': str(folder / 'recordings'), 'minutes': 1.0, 'files': 1000}
        site = {'case_recorder': recordings}
        self.theatre = None
        if options.cameras:
            from soak_theatre import CamerasAndTracker
            self.theatre = CamerasAndTracker(folder / 'theatre', str(CASE), self.igtl, dropouts, cleanup)
            site = self.theatre.site(recordings)
        (folder / 'site.yaml').write_text(yaml.safe_dump(site))
        launch.write_text(LAUNCH.format(root=ROOT, support=SUPPORT, folder=folder, page=self.page, igtl=self.igtl, dropouts=dropouts,
                                        phantom='' if self.theatre else CASE))
        self.log = open(folder / 'graph.log', 'w+', encoding='utf-8')
        cleanup.callback(self.log.close)
        self.start_master()
        cleanup.callback(lambda: end(self._roscore))
        self.nodes = subprocess.Popen(['roslaunch', '--wait', str(launch)], stdout=self.log, stderr=subprocess.STDOUT)
        cleanup.callback(end, self.nodes)

    def start_master(self):
        self._roscore = subprocess.Popen(['roscore', '-p', str(self._port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def end_master(self):
        """By a signal that it does not see coming."""
        import rosgraph
        os.kill(rosgraph.Master('/soak').getPid(), signal.SIGKILL)
        self._roscore.wait(60)   # by itself, with the last of its nodes

    def tail(self):
        self.log.flush()
        return ''.join(pathlib.Path(self.folder / 'graph.log').read_text(errors='replace').splitlines(keepends=True)[-60:])


def whole_stages(folder):
    """Keys of the stages on the disk whose content has the checksum in their name."""
    keys = set()
    for path in glob.glob(f'{folder}/case/[0-9]*.bag'):
        name = re.fullmatch(r'\d+_(.+)_([0-9a-f]{8})\.bag', os.path.basename(path))
        if name and zlib.crc32(pathlib.Path(path).read_bytes()) == int(name.group(2), 16):
            keys.add(name.group(1))
    return keys


def recorded_gaps(folder):
    """(topic, messages, longest gap [s]) over all parts of the recording that are whole."""
    import rosbag
    times, parts = {topic: [] for topic in RECORDED}, 0
    for path in sorted(glob.glob(f'{folder}/recordings/*.bag')):
        with rosbag.Bag(path) as bag:
            parts += 1
            for topic in RECORDED:
                times[topic] += [entry.time.to_sec() for index in bag._get_indexes(bag._get_connections([topic])) for entry in index]
    rows = []
    for topic, stamps in times.items():
        stamps.sort()
        rows.append((f'{topic}, in {parts} parts of the recording', len(stamps),
                     max((b - a for a, b in zip(stamps, stamps[1:])), default=float('nan'))))
    return rows


def run(options, folder, cleanup):
    """Lines of the report, and what is wrong."""
    graph = Graph(folder, options, cleanup)
    import rospy
    from soak_faults import Faults, Victims
    from soak_users import Reader, SlicerLike, Surgeon
    from soak_watch import Errors, Gaps, Memory
    deadline = time.monotonic() + START
    while subprocess.run(['rosparam', 'get', '/run_id'], capture_output=True, check=False).returncode and time.monotonic() < deadline:
        time.sleep(0.5)
    rospy.init_node('soak', disable_signals=True)
    gaps = Gaps()
    victims = Victims(gaps, graph.igtl, graph.page)
    faults = Faults(victims, graph, random.Random(options.seed))
    for topic in TOPICS:
        gaps.watch(topic)
    missing = [node for node in victims.nodes if victims.wait_whole(node, time.monotonic(), seconds=START) is None]
    if missing:
        return [], [f'the graph is not whole after {START:.0f} s: {", ".join(missing)}\n{graph.tail()}']
    errors, memory = Errors(faults.done), Memory(victims.nodes)
    surgeon = Surgeon(gaps, 2.0, 'soak', graph.theatre)
    while surgeon.capture() is None or not surgeon.acknowledged:
        if time.monotonic() > deadline + START:
            return [], [f'no capture is accepted: {surgeon.refusals}\n{graph.tail()}']
        time.sleep(0.5)
    wrong = [] if surgeon.track(surgeon.acknowledged[0]) else ['live mode is refused']
    users = [surgeon.start(), SlicerLike(gaps, graph.igtl).start(), Reader(gaps, graph.page).start()]
    began, until = time.monotonic(), time.monotonic() + 60 * options.minutes
    watching = threading.Event()

    def watch():
        while not watching.wait(5.0):
            memory.sample()
    sampler = threading.Thread(target=watch, daemon=True)
    sampler.start()
    quiet = until - QUIET if 60 * options.minutes >= LONG else until
    for _ in range(options.kills):
        for node in victims.nodes:
            faults.kill(node)
            time.sleep(1.0)
    if options.faults:
        faults.run(quiet)
    while time.monotonic() < until and graph.nodes.poll() is None:
        time.sleep(0.2)
    minutes = (time.monotonic() - began) / 60
    for user in users:
        user.stop()
    watching.set()
    sampler.join()
    memory.sample()
    # Afterwards everything is there again: each node, a capture, live mode.
    wrong += [f'{node} is not back' for node in victims.nodes if victims.wait_whole(node, time.monotonic()) is None]
    last = Surgeon(gaps, 0, 'last', graph.theatre)
    after = time.monotonic()
    while not last.acknowledged and time.monotonic() < after + 60:
        last.capture()
        time.sleep(0.3)
    if not last.acknowledged:
        wrong.append(f'no capture is accepted afterwards: {last.refusals}')
    live = gaps.since('/shift/field', after)
    if not live:
        time.sleep(5)
        live = gaps.since('/shift/field', after)
    if not live:
        wrong.append('live mode gives no field afterwards')
    ended = graph.nodes.poll()
    restarts = rospy.get_param('/restarts', {})
    own = [f'{node}: {told["why"]}' for node, told in restarts.items() if 'SIGKILL' not in told['why']]
    end(graph.nodes)
    kept = whole_stages(folder)
    acknowledged = [key for user in users[:2] for key in user.acknowledged] + last.acknowledged
    lost = sorted(set(acknowledged) - kept)
    if ended is not None:
        wrong.append(f'the launch ended by itself with status {ended}\n{graph.tail()}')
    wrong += [f'a node ended by itself: {line}' for line in own]
    wrong += [f'acknowledged, and lost: {", ".join(lost)}'] * bool(lost)
    wrong += [f'{fault.kind}: not whole after {fault.ended - fault.began:.0f} s' for fault in faults.done if fault.whole is None]
    wrong += [f'error without a fault before it: {name}: {text}' for name, text, _, unexplained, _ in errors.rows() if unexplained]
    grown = [(node, growth) for node, *_, growth in memory.rows() if growth is not None and growth > 2.0]
    wrong += [f'memory of {node} grew by {growth:.1f} % after its first ten minutes' for node, growth in grown]
    return report(options, graph, minutes, users, surgeon, last, faults.done, gaps, memory, errors, kept, lost, folder), wrong


def report(options, graph, minutes, users, surgeon, last, faults, gaps, memory, errors, kept, lost, folder):
    words = [f' --{name}' for name in ('faults', 'cameras', 'clock') if getattr(options, name)] + [f' --kills {options.kills}'] * bool(options.kills)
    command = f'script/soak {options.minutes:g}' + ''.join(words)
    lines = [f'`{command} --seed {options.seed}`: {minutes:.1f} minutes, {len(faults)} faults'
             + ('' if graph.own_disk or not options.faults else ' (no disk of its own here: none of a full one)') + '.', '']
    lines += ['| who asks | captures asked | acknowledged | refused | unanswered |', '| --- | --- | --- | --- | --- |']
    for name, user in (('by service', surgeon), ('over OpenIGTLink', users[1])):
        lines.append(f'| {name} | {user.counts.get("asked", 0)} | {len(user.acknowledged)} | {user.counts.get("refused", 0)} | '
                     f'{user.counts.get("unanswered", 0)} |')
    acknowledged = {key for user in users[:2] for key in user.acknowledged} | set(last.acknowledged)
    lines += ['', f'Acknowledged {len(acknowledged)}, found afterwards with their checksum {len(acknowledged & kept)}, lost {len(lost)}; '
              f'stored, but the answer was lost: {len(kept - acknowledged)}. Shifts asked {surgeon.counts.get("shifts asked", 0)}, computed {surgeon.shifts}; '
              f'fields, with those of live mode, {gaps.count("/shift/field")}.', '']
    if faults:
        lines += ['| fault | times | whole again after s, median / longest |', '| --- | --- | --- |']
        for kind in sorted({fault.kind for fault in faults}):
            of_kind = [fault.whole for fault in faults if fault.kind == kind]
            known = [whole for whole in of_kind if whole is not None]
            lines.append(f'| {kind} | {len(of_kind)} | ' + (f'{statistics.median(known):.1f} / {max(known):.1f} |' if known else 'never |'))
        lines.append('')
    lines += ['| stream | count | longest gap s | without a fault in it s |', '| --- | --- | --- | --- |']
    lines += [f'| `{name}` | {count} | {longest:.1f} | {quiet:.1f} |' for name, count, longest, quiet in gaps.rows(faults)]
    lines += [f'| {name} | {count} | {longest:.1f} | |' for name, count, longest in recorded_gaps(folder)]
    lines += ['', '| node | processes | longest life s | MB at its start / end | growth after ten minutes |', '| --- | --- | --- | --- | --- |']
    for node, processes, seconds, start, at_end, growth in memory.rows():
        lines.append(f'| {node} | {processes} | {seconds:.0f} | {start:.1f} / {at_end:.1f} | '
                     + (f'{growth:.1f} % |' if growth is not None else 'did not live so long |'))
    lines += ['', '| error of | text | times | without a fault before | after |', '| --- | --- | --- | --- | --- |']
    lines += [f'| {name} | {text[:110].replace("|", "/")} | {count} | {unexplained} | {after} |'
              for name, text, count, unexplained, after in errors.rows()] or ['| none | | | | |']
    return [line.replace(str(folder), 'FOLDER') for line in lines]


def main(arguments):
    options = options_of(arguments)
    with contextlib.ExitStack() as cleanup:
        if options.output:
            folder = pathlib.Path(options.output).resolve()
            folder.mkdir(parents=True, exist_ok=False)
        else:
            folder = pathlib.Path(tempfile.mkdtemp(prefix='cortshift_soak.'))
            cleanup.callback(shutil.rmtree, folder, ignore_errors=True)
        lines, wrong = run(options, folder, cleanup)
        text = '\n'.join(lines) + '\n'
        print(text, flush=True)
        if options.report:
            pathlib.Path(options.report).write_text(text, encoding='utf-8')
        if options.output and (folder / 'case').is_mount():
            try:
                shutil.copytree(folder / 'case', folder / 'case_kept')   # the disk goes with this process
            except (OSError, shutil.Error) as error:
                wrong.append(f'the case is not kept in {folder}: {str(error)[:200]}; give --output a folder on a larger disk')
    for line in wrong:
        print('WRONG:', line)
    print('failed' if wrong else 'passed')
    return 1 if wrong else 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
