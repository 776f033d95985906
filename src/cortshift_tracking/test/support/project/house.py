"""The rules of the house, each a function from a folder that holds the project to the sentences that say what breaks it.

A rule reads files alone: no build, no graph; only `unreached_tests` also reads what CMake wrote into the build folder."""
import ast
import os
import pathlib
import re

PACKAGES = ('cortshift_flow', 'cortshift_stereo', 'cortshift_tracking')
SOURCE_SUFFIXES = {'.cpp', '.hpp', '.py'}
TEXT_SUFFIXES = SOURCE_SUFFIXES | {'.cmake', '.txt', '.yaml', '.launch', '.test', '.xml', '.md', '.msg', '.srv', '.html', '.rviz',
                                   '.cff', ''}
MOST_LINES = 400
MOST_FILES = 15
TOP_FOLDERS = ('src', 'script', 'launch', 'config', 'workflow', 'doc', 'bags', '.ci')
# First part of an include that comes from ROS or from messages.
ROS_HEADER = re.compile(r'(ros|rosbag|roslib|rosgraph_msgs|roscpp|xmlrpcpp|cv_bridge|image_transport|message_filters|nodelet|pcl_ros'
                        r'|pcl_conversions|diagnostic_updater|tf|tf2\w*|\w+_msgs)/')


def files_of(root):
    """Every file of the project, without what a build or a run leaves."""
    for path in sorted(pathlib.Path(root).iterdir()):
        if path.is_file() and path.name != '.git':   # a file in a second working copy
            yield path
    for top in TOP_FOLDERS:
        for folder, below, names in os.walk(pathlib.Path(root) / top):
            below[:] = sorted(name for name in below if name not in ('__pycache__', '.pytest_cache'))
            yield from (pathlib.Path(folder) / name for name in sorted(names) if not name.endswith('.pyc'))


def is_python(path):
    if path.suffix == '.py':
        return True
    if path.suffix:
        return False
    with open(path, 'rb') as file:
        return b'python3' in file.readline()


def is_source(path):
    """C++ or Python, a program without suffix included."""
    return path.suffix in SOURCE_SUFFIXES or is_python(path)


def is_text(path):
    if path.suffix not in TEXT_SUFFIXES:
        return False
    return b'\0' not in path.read_bytes()[:4096]


# ---- who includes whom ---------------------------------------------------------------------------------------------------

INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', re.MULTILINE)


def include_roots(root, package):
    """Where a package's own includes are looked for, then what the other packages offer."""
    source = pathlib.Path(root) / 'src'
    own = source / package
    folders = [own / 'include', own / 'src', own / 'phantom/include', own / 'phantom/src', own / 'test/support']
    for other in PACKAGES:
        folders += [source / other / 'include', source / other / 'phantom/include']
    return folders


def package_of(root, path):
    return path.relative_to(pathlib.Path(root) / 'src').parts[0]


def cpp_graph(root):
    """File to (files of the project that it includes, names of the other headers)."""
    graph = {}
    for path in files_of(root):
        if path.suffix not in ('.cpp', '.hpp') or 'src' != path.relative_to(root).parts[0]:
            continue
        own, other = set(), set()
        for name in INCLUDE.findall(path.read_text()):
            candidates = [path.parent / name] + [folder / name for folder in include_roots(root, package_of(root, path))]
            found = next((candidate for candidate in candidates if candidate.is_file()), None)
            if found:
                own.add(found.resolve())
            else:
                other.add(name)
        graph[path.resolve()] = (own, other)
    return graph


def python_folder(root):
    return pathlib.Path(root) / 'src/cortshift_tracking/src/cortshift_tracking'


def python_graph(root):
    """Module file to the files of the package that it imports, also inside functions."""
    folder = python_folder(root)

    def file_of(module):
        inside = folder.joinpath(*module.split('.')[1:])
        return next((path for path in (inside.with_suffix('.py'), inside / '__init__.py') if path.is_file()), None)

    graph = {}
    for path in sorted(folder.rglob('*.py')):
        imported = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names = [f'{node.module}.{alias.name}' for alias in node.names]
                names = [name if file_of(name) else node.module for name in names]
            else:
                continue
            imported |= {file_of(name) for name in names if name.split('.')[0] == folder.name}
        graph[path] = {target for target in imported if target and target != path}
    return graph


def cycles(edges):
    """Sentences that name a cycle of files, each file in one at most."""
    state, found = {}, []

    def visit(node, trail):
        state[node] = 'open'
        for target in sorted(edges.get(node, ())):
            if state.get(target) == 'open':
                loop = trail[trail.index(target):] + [target] if target in trail else [node, target]
                found.append('a cycle: ' + ' -> '.join(path.name for path in loop))
            elif target not in state:
                visit(target, trail + [target])
        state[node] = 'done'

    for node in sorted(edges):
        if node not in state:
            visit(node, [node])
    return found


def include_cycles(root):
    return cycles({path: own for path, (own, _) in cpp_graph(root).items()})


def import_cycles(root):
    return cycles(python_graph(root))


# ---- rooms ---------------------------------------------------------------------------------------------------------------

def room_of(root, path):
    """For instance stereo/matching, stereo for what stands above the folders, tracking/phantom; None: not part of a library."""
    parts = path.relative_to(pathlib.Path(root) / 'src').parts
    package, inside = parts[0], list(parts[1:-1])
    if package not in PACKAGES or not inside or inside[0] not in ('include', 'src', 'phantom'):
        return None
    name = package[len('cortshift_'):]
    if inside[0] == 'phantom':
        return f'{name}/phantom'
    inside = inside[2:] if inside[0] == 'include' else inside[1:]
    return f'{name}/{inside[0]}' if inside else name


def broken_rooms(root, may_know):
    """`may_know`: room to the rooms that it may include besides itself; a name that ends in /* means a whole package."""
    found = []
    for path, (own, _) in cpp_graph(root).items():
        room = room_of(root, path)
        if room is None:
            continue
        if room not in may_know:
            found.append(f'{path.name}: the room {room} is not in the table of rooms; say there what it may include')
            continue
        for target in sorted(own):
            other = room_of(root, target)
            if other is None:
                found.append(f'{path.name} of {room} includes {target.name}, which belongs to no library')
            elif other != room and other not in may_know[room] and other.split('/')[0] + '/*' not in may_know[room]:
                found.append(f'{path.name} of {room} must not include {target.name} of {other}')
    return found


def broken_python_rooms(root, may_know):
    """The same for the folders of the Python package; its own top level is named `top`."""
    folder, found = python_folder(root), []

    def python_room(path):
        parts = path.relative_to(folder).parts
        return parts[0] if len(parts) > 1 else 'top'

    for path, targets in python_graph(root).items():
        room = python_room(path)
        if room not in may_know:
            found.append(f'{path.name}: the room {room} is not in the table of Python rooms; say there what it may import')
            continue
        for target in sorted(targets):
            if python_room(target) not in may_know[room] | {room}:
                found.append(f'{path.name} of {room} must not import {target.name} of {python_room(target)}')
    return found


def ros_in_cores(root, bordering):
    """Core files that see a ROS header, by themselves or through what they include. `bordering`: rooms that may."""
    graph, found = cpp_graph(root), []
    for path in graph:
        room = room_of(root, path)
        if room is None or room in bordering:
            continue
        seen, waiting = {path}, [path]
        while waiting:
            own, other = graph.get(waiting.pop(), (set(), set()))
            found += [f'{path.name} of {room} is core and includes {name}' for name in sorted(other) if ROS_HEADER.match(name)]
            waiting += own - seen
            seen |= own
    return found


def logs_of_files(root, rooms):
    """Files of the `rooms` that know messages and bags as a format alone, which speak to a node's log by themselves."""
    return [f'{path.name} of {room} includes {name}: return what is to be said, the node says it'
            for path, (_, other) in cpp_graph(root).items() if (room := room_of(root, path)) in rooms
            for name in sorted(other) if name in ('ros/console.h', 'ros/ros.h', 'ros/node_handle.h')]


# ---- sizes ---------------------------------------------------------------------------------------------------------------

def long_files(root, excused):
    """`excused`: path within the project to the reason why one job needs so many lines."""
    lengths = {str(path.relative_to(root)): len(path.read_bytes().splitlines())
               for path in files_of(root) if is_source(path) or path.suffix in ('.cmake', '.html')}
    found = [f'{name} has {lines} lines, {MOST_LINES} at most: what are its jobs?'
             for name, lines in lengths.items() if lines > MOST_LINES and name not in excused]
    return found + [f'{name} is excused and need not be: take it from the list'
                    for name in excused if lengths.get(name, 0) <= MOST_LINES]


def full_folders(root):
    count = {}
    for path in files_of(root):
        if is_source(path):
            count[path.parent] = count.get(path.parent, 0) + 1
    return [f'{folder.relative_to(root)} holds {files} source files, {MOST_FILES} at most'
            for folder, files in sorted(count.items()) if files > MOST_FILES]


# ---- tests ---------------------------------------------------------------------------------------------------------------

IS_TEST = re.compile(r'^(TEST|TEST_F|TEST_P|TYPED_TEST)\(|^def test_|^class \w+\(unittest\.TestCase\)', re.MULTILINE)


def files_of_tests(root):
    for package in sorted((pathlib.Path(root) / 'src').iterdir()):
        if (package / 'test').is_dir():
            yield from (path for path in files_of(root) if package / 'test' in path.parents)


def misnamed_tests(root):
    found = []
    for path in files_of_tests(root):
        name = path.relative_to(root)
        if path.suffix == '.test':
            if not any((path.parent / f'{path.stem}_test{suffix}').is_file() for suffix in ('.py', '.cpp')):
                found.append(f'{name} starts no {path.stem}_test beside it')
        elif path.suffix in ('.cpp', '.py'):
            holds_tests = IS_TEST.search(path.read_text())
            if holds_tests and not path.stem.endswith('_test'):
                found.append(f'{name} holds tests: its name must end in _test')
            if path.stem.endswith('_test') and 'support' in path.relative_to(root).parts:
                found.append(f'{name} is a test among the helpers')
    return found


def unreached_tests(root, build):
    """Tests that no target of the build compiles and no ctest runs."""
    root, build = pathlib.Path(root), pathlib.Path(build)
    known = ''.join(path.read_text() for path in build.rglob('CTestTestfile.cmake'))
    if 'add_test' not in known:
        return [f'{build} knows no test: build the tests first (script/build --tests)']
    compiled = '\n'.join(path.read_text() for path in build.rglob('build.make') if 'CMakeFiles' in path.parts)
    found = []
    for path in files_of_tests(root):
        package, inside = path.relative_to(root / 'src').parts[0], '/'.join(path.relative_to(root / 'src').parts[1:])
        reached = True
        if path.suffix == '.cpp' and path.stem.endswith('_test'):
            reached = f'src/{package}/{inside}' in compiled
        elif path.suffix == '.test':
            reached = re.search(rf'[\s"/]{re.escape(inside)}[\s"]', known)
        elif path.suffix == '.py' and path.stem.endswith('_test'):
            launch = path.with_name(path.stem[:-len('_test')] + '.test')
            if launch.is_file():
                reached = path.name in launch.read_text()
            else:
                reached = re.search(rf'[\s"/]{re.escape(inside)}[\s"]', known)
        if not reached:
            found.append(f'src/{package}/{inside} is run by no ctest: name it in the CMake files of {package}')
    return found


# ---- paths ---------------------------------------------------------------------------------------------------------------

# Folders of one machine or one person. Those that every Debian has (/usr, /etc, /tmp, ...) may be named.
PRIVATE = re.compile(r'(?<![\w.$}~-])/(?:home|root|Users|work|mnt|media|srv)(?=/|\b)(?![\w.-]*\.)')
UPWARDS = re.compile(r'(?<![.\w])(?:\.\./)+(?:\.\.)?|(?<=/)\.\.(?=["\'\s)]|$)')


def paths_outside(root):
    found = []
    for path in files_of(root):
        if not is_text(path):
            continue
        name, depth = path.relative_to(root), len(path.relative_to(root).parts) - 1
        for number, line in enumerate(path.read_text().splitlines(), 1):
            for match in PRIVATE.finditer(line):
                found.append(f'{name}:{number} names {match.group()}, a folder of one machine')
            if any(match.group().count('..') > depth for match in UPWARDS.finditer(line)):
                found.append(f'{name}:{number} leads out of the project')
    return found
