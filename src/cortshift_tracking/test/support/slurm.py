"""A Slurm of one node for tests: munged, slurmctld and slurmd as the user who tests, with ports and folders of their own."""
import getpass
import os
import secrets
import shutil
import signal
import socket
import subprocess
import tempfile
import time

from programs import free_ports

# No control groups, no accounting: neither rights nor a system manager are needed, nor is anything outside of the folder.
# cred_expire [s]: how long the jobs of a node that went down wait before they start again; 5 is the least that Slurm takes.
CONFIGURATION = '''ClusterName=cortshift_test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/builtin
SchedulerParameters=batch_sched_delay=0,sched_interval=1
ReturnToService=2
NodeName=node NodeHostname={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory={memory_mb}
PartitionName=main Nodes=node Default=YES MaxTime=INFINITE State=UP
'''


def _variables(pid):
    """Environment of a process; none where it is gone or another user's."""
    try:
        with open(f'/proc/{pid}/environ', 'rb') as file:
            return dict(entry.partition(b'=')[::2] for entry in file.read().split(b'\0'))
    except OSError:
        return {}


class Slurm:
    """with Slurm() as slurm: subprocess.run(['sbatch', ...], env=slurm.environment)"""

    def __init__(self, cores=2):
        missing = [name for name in ('munged', 'slurmctld', 'slurmd') if not shutil.which(name, path='/usr/sbin:/usr/bin')]
        assert not missing, f'{", ".join(missing)}: not installed; run script/install --tests'
        # Not pytest's folder, which nobody else may enter: munged refuses to put its socket there.
        self.folder = tempfile.mkdtemp(prefix='cortshift_slurm.')
        os.chmod(self.folder, 0o711)
        self.environment = dict(os.environ, SLURM_CONF=os.path.join(self.folder, 'slurm.conf'))
        self._processes, self._starts = {}, 0
        controller_port, node_port = free_ports(2)
        memory_mb = os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') >> 20
        with open(self.environment['SLURM_CONF'], 'w', encoding='utf-8') as file:
            file.write(CONFIGURATION.format(host=socket.gethostname(), user=getpass.getuser(), folder=self.folder, cores=cores,
                                            memory_mb=memory_mb, controller_port=controller_port, node_port=node_port))
        for name in ('state', 'spool'):
            os.mkdir(os.path.join(self.folder, name), 0o755)
        with open(os.open(os.path.join(self.folder, 'munge.key'), os.O_WRONLY | os.O_CREAT, 0o400), 'wb') as file:
            file.write(secrets.token_bytes(128))

    def __enter__(self):
        try:
            # --force: a root folder that is closed to others (a chroot's) is warned of, not refused; all here run as one user.
            self._start('munged', '--foreground', '--force', *(f'--{name}-file={self.folder}/munge.{name}' for name in ('key', 'pid', 'seed')),
                        f'--log-file={self.folder}/munge.log', f'--socket={self.folder}/munge.socket')
            self._wait_for('munged', lambda: os.path.exists(os.path.join(self.folder, 'munge.socket')))
            self._start('slurmctld', '-D')
            self.start_node()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        self.kill_node()
        for process in reversed(list(self._processes.values())):
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        shutil.rmtree(self.folder)

    def _start(self, name, *arguments):
        with open(os.path.join(self.folder, name + '.out'), 'ab') as out:
            # Should the test be killed, they end with it.
            self._processes[name] = subprocess.Popen(['setpriv', '--pdeathsig', 'TERM', '/usr/sbin/' + name, *arguments], stdout=out,
                                                     stderr=out, stdin=subprocess.DEVNULL, env=self.environment)

    def _wait_for(self, name, condition):
        end = time.monotonic() + 60
        while not condition():
            status = self._processes[name].poll()
            if status is not None or time.monotonic() > end:
                with open(os.path.join(self.folder, name + '.out'), encoding='utf-8', errors='replace') as file:
                    said = ''.join(file.readlines()[-20:])
                ended = 'is not ready after 60 s' if status is None else f'ended with {status}'
                raise AssertionError(f'{name} {ended}, as {getpass.getuser()} on {socket.gethostname()}; it said:\n{said}')
            time.sleep(0.05)

    def ask(self, *command):
        """What a command of Slurm prints; nothing while slurmctld does not answer."""
        return subprocess.run(command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                              universal_newlines=True, check=False).stdout

    def node_state(self):
        return self.ask('sinfo', '--noheader', '--format=%T').strip().rstrip('*')   # the mark of one that does not answer

    def start_node(self):
        """Start slurmd, and wait until jobs can run on the node."""
        self._start('slurmd', '-D', '-N', 'node')
        self._starts += 1

        def ready():
            with open(os.path.join(self.folder, 'slurmd.out'), encoding='utf-8', errors='replace') as file:
                started = file.read().count('slurmd started on')
            return started == self._starts and self.node_state() in ('idle', 'mixed', 'allocated')
        if self._starts > 1:
            self.ask('scontrol', 'update', 'NodeName=node', 'State=RESUME')
        self._wait_for('slurmd', ready)

    def job_processes(self):
        """Processes of this Slurm's jobs, and the daemons that started them."""
        found = []
        for pid in filter(str.isdigit, os.listdir('/proc')):
            variables = _variables(pid)
            if variables.get(b'SLURM_CONF', b'').decode() != self.environment['SLURM_CONF']:
                continue
            try:
                with open(f'/proc/{pid}/comm', encoding='utf-8') as file:
                    step = file.read().startswith('slurmstepd')
            except OSError:
                continue
            if step or b'SLURM_JOB_ID' in variables:
                found.append(int(pid))
        return found

    def running_jobs(self):
        """Names of the jobs that run."""
        return self.ask('squeue', '--noheader', '--states=RUNNING', '--format=%j').split()

    def signal_jobs(self, number):
        for pid in self.job_processes():
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                pass

    def fail_node(self):
        """Kill the node, and say so as Slurm itself does when SlurmdTimeout is over: its jobs are queued again."""
        self.kill_node()
        self.ask('scontrol', 'update', 'NodeName=node', 'State=DOWN', 'Reason=killed')
        assert self.node_state() == 'down'

    def kill_node(self):
        """As where the node's power fails: slurmd and all that its jobs run are gone at once."""
        process = self._processes.pop('slurmd', None)
        if process:
            process.kill()
            process.wait()
        while self.job_processes():
            self.signal_jobs(signal.SIGKILL)
            time.sleep(0.05)
