"""Names of stages, probe points and cohort cases: the same rule everywhere, as in cortshift_tracking/case/stage_key.hpp."""
import re

RULE = '1-64 of A-Z a-z 0-9 _ -'
_KEY = re.compile(r'[A-Za-z0-9_-]{1,64}\Z')


def is_key(text):
    return bool(_KEY.match(text))


def all_pairs(keys):
    """(earlier, later) of every stage and the next one, and of the first and the last."""
    pairs = list(zip(keys, keys[1:]))
    if len(keys) > 2:
        pairs.append((keys[0], keys[-1]))
    return pairs
