"""``bozzini evaluate``: rate a policy of the learning environment in phantoms."""

from __future__ import annotations

from ..physics.evaluating import PolicyEvaluation
from .task import make_command

command = make_command(PolicyEvaluation)
