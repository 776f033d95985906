"""What every command-line tool of the package does the same way: its help, and how a refusal ends it."""
import argparse
import os
import sys

from cortshift_tracking.errors import CortshiftError

TRACEBACK = 'CORTSHIFT_TRACEBACK'  # environment: faults of the tools themselves are shown in full


def parser_of(name, documentation):
    """An argparse parser whose help is the tool's documentation; its second paragraph is the usage."""
    return argparse.ArgumentParser(prog=name, usage=documentation.split('\n\n')[1].strip(), description=documentation,
                                   formatter_class=argparse.RawDescriptionHelpFormatter)


def ended_by(name, work, *arguments, refusals=()):
    """Exit status of a tool: that of work(*arguments), or 1 with the reason on stderr where it was refused.

    refusals: exceptions besides CortshiftError and OSError whose message says what to do.
    """
    try:
        return work(*arguments) or 0
    except (CortshiftError, *refusals) as error:
        reason = str(error)
    except OSError as error:
        reason = f'{error.filename}: {error.strerror}' if error.filename else error.strerror or 'input or output failed'
    except KeyboardInterrupt:
        return 130
    except MemoryError:
        reason = 'not enough memory; close other programs, or give smaller images'
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        reason = f'a fault of the tool itself ({type(error).__name__}: {error}); please report it with what {TRACEBACK}=1 shows'
    print(f'{name}: {reason}', file=sys.stderr)
    return 1
