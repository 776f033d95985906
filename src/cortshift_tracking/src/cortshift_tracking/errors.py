"""Refusals. Every message names the thing (file, key, value) and what to do about it."""


class CortshiftError(Exception):
    """Input that cannot be used; what a tool prints before it exits with 1 and a service answers with."""


class VolumeError(CortshiftError):
    """An MR volume whose file, header or geometry cannot be trusted."""


class ProbeError(CortshiftError):
    """A probe measurement that is not one: the tip moved, tracking dropped, a geometry that says nothing."""


class CaseError(CortshiftError):
    """A case folder that lacks something, or a file in it that is damaged."""
