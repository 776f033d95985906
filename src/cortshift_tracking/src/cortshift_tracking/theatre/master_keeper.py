"""Puts into a new ROS master what the old one knew, so that a graph outlives its master.

A master that is started again knows neither nodes nor parameters, and nodes of ROS 1 register once. Here what the master knows is
copied once a second. When another master answers at the same address, every node that still lives is registered there under its
own name, and the parameters that it lacks are set, `/run_id` too, by which nodes that start again find their case. Topics go from node
to node and services to nodes: what flows is not interrupted. Not brought back: who asked to be told of changes of a parameter.
"""
import http.client
import time
import xmlrpc.client
from dataclasses import dataclass, field

import rosgraph
import rospy

LOOK = 1.0       # s between copies of what the master knows
ANSWER = 2.0     # s that a node has to answer
NEW_RUN = 5.0    # s for a new roscore to set /run_id; set before, it would end at the sight of another one
UNREACHABLE = (OSError, http.client.HTTPException, xmlrpc.client.Error, rosgraph.MasterException)


class Impatient(xmlrpc.client.Transport):
    def make_connection(self, host):
        connection = super().make_connection(host)
        connection.timeout = ANSWER
        return connection


def ask(address, call, *arguments):
    """What a master or node answers. @raises one of UNREACHABLE, rosgraph.MasterException where it does not know"""
    code, told, value = getattr(xmlrpc.client.ServerProxy(address, transport=Impatient()), call)(*arguments)
    if code != 1:
        raise rosgraph.MasterException(told)
    return value


@dataclass
class Knowledge:
    """Of a master: parameters as a tree, address of each node's own interface, (node, address) of each service."""
    parameters: dict = field(default_factory=dict)
    nodes: dict = field(default_factory=dict)
    services: dict = field(default_factory=dict)


class Master:
    def __init__(self, address, name):
        self._address, self._name = address, name

    def __call__(self, call, *arguments, name=None):
        return ask(self._address, call, name or self._name, *arguments)

    def knows(self, node):
        try:
            self('lookupNode', node)
            return True
        except rosgraph.MasterException:
            return False

    def knowledge(self):
        *topics, services = self('getSystemState')
        nodes = {node for kind in (*topics, services) for _, names in kind for node in names}
        return Knowledge(self('getParam', '/'), {node: self('lookupNode', node) for node in nodes},
                         {service: (names[0], self('lookupService', service)) for service, names in services})

    def teach(self, before):
        """Registers the nodes of `before` that live and that it does not know, and sets the parameters that it lacks. Their names."""
        until = time.monotonic() + NEW_RUN
        while 'run_id' in before.parameters and not self('hasParam', '/run_id') and time.monotonic() < until:
            time.sleep(0.1)
        self._set_missing('', before.parameters, self('getParam', '/'))
        if 'run_id' in before.parameters:
            self('setParam', '/run_id', before.parameters['run_id'])
        back = self._register(before, set(before.nodes) - {self._name})
        return back | self._register(before, {self._name})   # last: by its own name it knows a master that was taught

    def _register(self, before, nodes):
        published, subscribed, back = [], [], set()
        for node in nodes:
            if self.knows(node):
                continue   # started again, and registered by itself
            address = before.nodes[node]
            try:
                published += [(node, *topic, address) for topic in ask(address, 'getPublications', self._name)]
                subscribed += [(node, *topic, address) for topic in ask(address, 'getSubscriptions', self._name)]
                back.add(node)
            except UNREACHABLE:
                pass       # it died with the master
        # Publishers first: a subscriber that is told of some of its publishers leaves the others.
        for node, *topic in published:
            self('registerPublisher', *topic, name=node)
        for service, (node, address) in before.services.items():
            if node in back:
                self('registerService', service, address, before.nodes[node], name=node)
        for node, topic, kind, address in subscribed:
            publishers = self('registerSubscriber', topic, kind, address, name=node)
            ask(address, 'publisherUpdate', '/master', topic, publishers)   # those that have started since then are new to it
        return back

    def _set_missing(self, space, wanted, there):
        for name, value in wanted.items():
            if name not in there:
                self('setParam', f'{space}/{name}', value)
            elif isinstance(value, dict) and isinstance(there[name], dict):
                self._set_missing(f'{space}/{name}', value, there[name])


def keep(master, name):
    """Until the node ends. Copies, and teaches a master that does not know `name`."""
    known = Knowledge()
    while not rospy.is_shutdown():
        try:
            found = master.knowledge()
            if name in found.nodes:
                known = found
            elif known.nodes:
                back = master.teach(known)
                rospy.logwarn('The master was started again; put into the new one: parameters, %s; already there, or gone: %s', ' '.join(sorted(back)),
                              ' '.join(sorted(set(known.nodes) - back)))
        except UNREACHABLE:
            pass   # it is gone, or just going: looked at again
        time.sleep(LOOK)


def main():
    rospy.init_node('master_keeper')
    keep(Master(rosgraph.get_master_uri(), rospy.get_name()), rospy.get_name())
    return 0
