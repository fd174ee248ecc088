"""The two ways in which Isochrome says no.

Every refusal is one sentence that names the file, key or frame, the value found, what is
allowed and what to do. The command line turns them into the exit codes 2 and 3.
"""

from __future__ import annotations


class IsochromeError(Exception):
    """A refusal with a sentence for the user; never raised itself."""

    exit_code = 1


class InputError(IsochromeError, ValueError):
    """The input or the scene is wrong (exit code 2)."""

    exit_code = 2


class PhysicsError(IsochromeError, ArithmeticError):
    """The input is well formed, but its physics cannot be computed honestly (exit code 3)."""

    exit_code = 3
