"""Puts into a new ROS master what the old one knew, so that a graph outlives its master.

A master that is started again knows neither nodes nor parameters, and nodes of ROS 1 register once. Here what the master knows is
copied once a second. When another master answers at the same address, every node that is still there is registered under its own
name, and the parameters that it lacks are set; at the end `/run_id`, by which nodes that start again find their case, and
script/supervise sees that it may start them. Topics go from node to node and services to nodes: what flows is not interrupted. Not
brought back: what was registered in the last second, who asked to be told of changes of a parameter, and anything should this
node end together with the master.
"""
import time
import xmlrpc.client
from dataclasses import dataclass, field

import rosgraph
import rospy

LOOK = 1.0        # s between copies of what the master knows
ANSWER = 2.0      # s that a node has to answer
NEW_RUN = 20.0    # s for a new roscore to set /run_id; were it there before, roscore would end at the sight of another one
ITS_OWN = ('run_id', 'roslaunch')   # parameters that a new roscore sets for itself


class Impatient(xmlrpc.client.Transport):
    def make_connection(self, host):
        connection = super().make_connection(host)
        connection.timeout = ANSWER
        return connection


def ask(address, call, *arguments):
    """What a master or node answers. @raises rosgraph.MasterException where it does not know, and whatever the network does"""
    return value_of(getattr(xmlrpc.client.ServerProxy(address, transport=Impatient()), call)(*arguments))


def value_of(answer):
    code, told, value = answer
    if code != 1:
        raise rosgraph.MasterException(told)
    return value


def is_gone(address, name):
    """Whether nobody listens there. A node that hangs is not gone."""
    try:
        ask(address, 'getPid', name)
    except ConnectionRefusedError:
        return True
    except Exception:  # it may be slow, or stand still
        pass
    return False


@dataclass
class Knowledge:
    """Of a master: parameters as a tree; address of each node's own interface; (node, topic, type) of publishers and of subscribers;
    (service, node, address)."""
    parameters: dict = field(default_factory=dict)
    nodes: dict = field(default_factory=dict)
    published: list = field(default_factory=list)
    subscribed: list = field(default_factory=list)
    services: list = field(default_factory=list)


class Master:
    def __init__(self, address, name):
        self._address, self._name, self._new_since = address, name, None

    def __call__(self, call, *arguments, name=None):
        return ask(self._address, call, name or self._name, *arguments)

    def _ask_all(self, call, names):
        """{name: value} of one request for all of them."""
        calls = [{'methodName': call, 'params': [self._name, name]} for name in names]
        answers = xmlrpc.client.ServerProxy(self._address, transport=Impatient()).system.multicall(calls) if calls else []
        return {name: value_of(answer[0]) for name, answer in zip(names, answers)}

    def _finds(self, call, name):
        try:
            return self(call, name)
        except rosgraph.MasterException:
            return None

    def knowledge(self):
        published, subscribed, services = self('getSystemState')
        kinds = dict(self('getTopicTypes'))
        nodes = sorted({node for kind in (published, subscribed, services) for _, names in kind for node in names})
        addresses = self._ask_all('lookupService', [service for service, _ in services])
        return Knowledge(self('getParam', '/'), self._ask_all('lookupNode', nodes),
                         [(node, topic, kinds.get(topic, '*')) for topic, names in published for node in names],
                         [(node, topic, kinds.get(topic, '*')) for topic, names in subscribed for node in names],
                         [(service, names[0], addresses[service]) for service, names in services])

    def teach(self, before):
        """Registers the nodes of `before` that are there still, and sets the parameters that it lacks. May be done again.

        @return names of nodes; None: it is too early
        """
        self._new_since = self._new_since or time.monotonic()
        if 'run_id' in before.parameters and not self('hasParam', '/run_id') and time.monotonic() < self._new_since + NEW_RUN:
            return None
        self._set_missing('', {name: value for name, value in before.parameters.items() if name not in ITS_OWN}, self('getParam', '/'))
        # A node that was started again has registered itself, from another address.
        there = {node for node, address in before.nodes.items()
                 if self._finds('lookupNode', node) in (None, address) and not is_gone(address, self._name)}
        self._register(before, there - {self._name})
        if 'run_id' in before.parameters:
            self('setParam', '/run_id', before.parameters['run_id'])
        self._register(before, there & {self._name})   # last: by its own name it sees that a master has been taught
        self._new_since = None
        return there

    def _register(self, before, nodes):
        # Publishers first: a subscriber that is told of some of its publishers leaves the others.
        for node, topic, kind in before.published:
            if node in nodes:
                self('registerPublisher', topic, kind, before.nodes[node], name=node)
        for service, node, address in before.services:
            if node in nodes and self._finds('lookupService', service) is None:
                self('registerService', service, address, before.nodes[node], name=node)
        for node, topic, kind in before.subscribed:
            if node in nodes:
                self._tell(before.nodes[node], topic, self('registerSubscriber', topic, kind, before.nodes[node], name=node))

    @staticmethod
    def _tell(address, topic, publishers):
        """A subscriber of all publishers: those that have started since are new to it."""
        try:
            ask(address, 'publisherUpdate', '/master', topic, publishers)
        except Exception:  # it hangs, or died just now
            pass

    def _set_missing(self, space, wanted, there):
        for name, value in wanted.items():
            if name not in there:
                self('setParam', f'{space}/{name}', value)
            elif isinstance(value, dict) and isinstance(there[name], dict):
                self._set_missing(f'{space}/{name}', value, there[name])


def keep(master, name):
    """Until the node ends. Copies, and teaches a master that does not know `name`."""
    known, failure = Knowledge(), ''
    while not rospy.is_shutdown():
        try:
            found = master.knowledge()
            if name in found.nodes:
                known = found
            elif known.nodes:
                back = master.teach(known)
                if back is not None:
                    rospy.logwarn('The master was started again; put into the new one: parameters, %s; not: %s', ' '.join(sorted(back)),
                                  ' '.join(sorted(set(known.nodes) - back)))
            failure = ''
        except Exception as error:  # the master is gone, or just going: whatever that looks like, it is looked at again
            if str(error) != failure and not isinstance(error, OSError):
                rospy.logwarn('what the master knows is not copied or put back just now: %s', error)
            failure = str(error)
        time.sleep(LOOK)


def main():
    rospy.init_node('master_keeper')
    keep(Master(rosgraph.get_master_uri(), rospy.get_name()), rospy.get_name())
    return 0
