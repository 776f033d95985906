"""Private ROS parameters of a Python node: each default once, range checked, unknown keys refused."""
import math
from dataclasses import dataclass, fields

import rospy


class ParameterError(Exception):
    """A parameter that is missing, unknown, of the wrong type or out of range. The message names key, value and range."""


@dataclass(frozen=True)
class Number:
    """A default with the allowed range."""
    default: float
    low: float
    high: float


def read_parameters(specification, required=()):
    """Private parameters as a dict.

    specification: {key: Number, str or list of numbers}; the value is the default and gives the type.
    required: keys of text that must be given.
    Raises ParameterError.
    """
    given = rospy.get_param('~', {})
    prefix = rospy.get_name()
    known = set(specification) | set(required)
    for key in given:
        if key not in known:
            raise ParameterError(f'parameter {prefix}/{key} is unknown; known are: {" ".join(sorted(known))}')
    values = {}
    for key in required:
        if not isinstance(given.get(key), str) or not given[key]:
            raise ParameterError(f'parameter {prefix}/{key} is missing; set it in the launch file or config')
        values[key] = given[key]
    for key, standard in specification.items():
        values[key] = _checked(f'{prefix}/{key}', given[key], standard) if key in given else getattr(standard, 'default',
                                                                                                     standard)
    rospy.loginfo('configuration of %s: %s', prefix, ' '.join(f'{k}={v}' for k, v in sorted(values.items())))
    return values


def _checked(name, value, standard):
    if isinstance(standard, Number):
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ParameterError(f'parameter {name} = {value!r} is not a number')
        if not standard.low <= value <= standard.high:
            raise ParameterError(f'parameter {name} = {value} is not allowed; allowed is {standard.low} ... {standard.high}')
        return type(standard.default)(value)
    if isinstance(standard, str):
        if not isinstance(value, str):
            raise ParameterError(f'parameter {name} = {value!r} is not a text')
        return value
    if not isinstance(value, list) or len(value) != len(standard) or not all(
            isinstance(v, (int, float)) and math.isfinite(v) for v in value):
        raise ParameterError(f'parameter {name} = {value!r} is not allowed; allowed is a list of {len(standard)} numbers')
    return [float(v) for v in value]


def settings_from(kind, values):
    """A settings dataclass from the parameters that carry its fields' names."""
    return kind(**{field.name: values[field.name] for field in fields(kind)})
