"""The console's worker and what it shows of the graph, without a graph."""
import threading
import time
import types

import pytest
import rospy
from cortshift_msgs.msg import ShiftSummary, StageInfo
from cortshift_msgs.srv import ListStagesResponse
from cortshift_tracking.console import desk
from cortshift_tracking.console.graph_state import SILENCE, GraphState
from cortshift_tracking.console.terminal import tracker_words
from cortshift_tracking.console.worker import DeskError, Worker
from cortshift_tracking.summary_text import summary_lines
from cortshift_tracking.tracker_state import TRACKER_STATE
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue


def done(worker):
    end = time.monotonic() + 20
    while worker.activity.busy:
        assert time.monotonic() < end
        time.sleep(0.005)
    return worker.activity


@pytest.mark.parametrize('fault', [TypeError('not a number'), KeyError('x'), RuntimeError('odd'), OSError(5, 'Input/output error')])
def test_nothing_ends_the_worker(fault):
    logged = []

    def fails():
        raise fault
    worker = Worker(logged.append)
    worker.ask('capturing', 1, fails)
    activity = done(worker)
    assert not activity.success and 'capturing failed by a fault of the console' in activity.message
    assert type(fault).__name__ in activity.message and 'Traceback' in logged[0]
    worker.ask('capturing', 1, lambda: ('stored', (('overlap', '90 %'),)))
    activity = done(worker)
    assert activity.success and activity.message == 'stored' and activity.summary


def test_a_refusal_and_a_second_request():
    go = threading.Event()

    def refused():
        go.wait(20)
        raise DeskError('no stage; capture one')
    worker = Worker()
    worker.ask('computing', 1, refused)
    with pytest.raises(DeskError, match='computing is still under way'):
        worker.ask('capturing', 1, refused)
    assert worker.progress() < 1
    go.set()
    assert done(worker).message == 'no stage; capture one' and worker.progress() == 1


class NoGraph:
    """In the place of rospy: services that answer what a test says, and nothing else. Faults are logged in `errors`."""
    ServiceException, ROSException = rospy.ServiceException, rospy.ROSException

    def __init__(self, list_stages):
        self._list_stages, self.errors, self.ended = list_stages, [], False
        self.get_namespace, self.Subscriber = (lambda: '/'), (lambda *_, **__: None)
        self.is_shutdown, self.get_param = (lambda: self.ended), (lambda _, default=None: default)
        self.logerr = lambda text, *values: self.errors.append(text % values)

    def ServiceProxy(self, name, _):
        def absent(**_):
            raise rospy.ROSException('no such service')
        answer = self._list_stages if name.endswith('list_stages') else None
        return types.SimpleNamespace(wait_for_service=absent) if answer is None else answer


@pytest.mark.parametrize('fault', [TypeError('not a number'), rospy.ROSException('odd'), OSError(24, 'Too many open files')])
def test_nothing_ends_the_look_at_the_graph(monkeypatch, fault):
    looks = []

    def list_stages():
        looks.append(None)
        if len(looks) == 1:
            raise fault
        return ListStagesResponse([StageInfo(key='first')])
    graph = NoGraph(list_stages)
    monkeypatch.setattr(desk, 'rospy', graph)
    try:
        shown, end = desk.Desk(), time.monotonic() + 20
        while not shown.stages:
            assert time.monotonic() < end, 'it does not look again'
            time.sleep(0.02)
    finally:
        graph.ended = True
    assert [stage.key for stage in shown.stages] == ['first'] and type(fault).__name__ in graph.errors[0]


def state(**values):
    return DiagnosticArray(status=[DiagnosticStatus(name=TRACKER_STATE, values=[KeyValue(k, v) for k, v in values.items()])])


def test_what_the_tracker_says_is_shown():
    now = [100.0]
    graph = GraphState(lambda: now[0])
    assert tracker_words(graph.tracker()) == ['live unknown', 'gravity unknown']
    graph.keep(state(live='on', live_from='stage_01', gravity='0 0 -1', excluded_stages='stage_01, stage_03'))
    assert tracker_words(graph.tracker()) == ['live on from stage_01', 'gravity known', 'regions excluded at stage_01, stage_03']
    graph.keep(state(live='off', live_from='', gravity='not known', excluded_stages=''))  # restarted
    assert graph.tracker().live is False and tracker_words(graph.tracker()) == ['live off', 'gravity not known']
    now[0] += SILENCE + 0.1
    assert graph.tracker().live is None and tracker_words(graph.tracker()) == ['live unknown', 'gravity unknown']
    assert f'nothing is heard of shift_tracker for {SILENCE:.0f} s' in graph.warnings()


def test_coverage_and_warnings_are_of_now():
    now = [0.0]
    graph = GraphState(lambda: now[0])
    graph.keep(DiagnosticArray(status=[DiagnosticStatus(DiagnosticStatus.WARN, 'surface_reconstruction: surface', 'too dark', '',
                                                        [KeyValue('coverage', '0.8')])]))
    assert graph.coverage() == 0.8 and 'surface_reconstruction: surface: too dark' in graph.warnings()
    now[0] = 2 * SILENCE
    assert graph.coverage() is None and 'surface_reconstruction: surface: too dark' not in graph.warnings()


def test_what_is_started_again_is_shown_for_a_while():
    wall = [1000.0]
    graph = GraphState(wall_clock=lambda: wall[0])
    graph.keep_restarts({'shift_tracker': {'count': 2, 'why': 'signal 9 (SIGKILL) ended it', 'time': 990.0}})
    assert 'shift_tracker is started again (signal 9 (SIGKILL) ended it); in this launch for the 2nd time' in graph.warnings()
    wall[0] = 1100.0
    assert not any('started again' in text for text in graph.warnings())


def test_a_graph_in_a_namespace_knows_its_own_nodes():
    graph, other = GraphState(namespace='/or1/'), GraphState(namespace='/or2/')
    message = DiagnosticArray(status=[DiagnosticStatus(name='or1/' + TRACKER_STATE, values=[KeyValue('live', 'on'), KeyValue('live_from', 'a')])])
    for each in (graph, other):
        each.keep(message)
    assert graph.tracker().live_from == 'a' and other.tracker().live is None
    assert 'nothing is heard of shift_tracker' in other.warnings() and 'nothing is heard of shift_tracker' not in graph.warnings()


def test_a_live_field_says_how_late_it_is():
    numbers = {f'{name}_{kind}': 0.002 for name in ('magnitude', 'gravity', 'normal', 'lateral') for kind in ('mean', 'sd')}
    live, asked = (ShiftSummary(latency=latency, **numbers) for latency in (0.184, float('nan')))
    assert ('after the exposure by', '0.18 s') in summary_lines(live)
    assert 'after the exposure by' not in dict(summary_lines(asked))
