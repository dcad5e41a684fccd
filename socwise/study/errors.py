"""What can be wrong with a study, for the user to mend."""

from __future__ import annotations

from collections.abc import Sequence

from ems.errors import EmsError


class StudyError(EmsError):
    """A study that cannot be run, or a folder that holds none; the message says what to do.

    Parameters
    ----------
    message : str
        For the user.
    problems : sequence of str
        One line for each thing that is wrong, each with its path in the study file.
    """

    def __init__(self, message: str, problems: Sequence[str] = ()) -> None:
        super().__init__("\n".join([message, *(f"  {problem}" for problem in problems)]))
        self.problems = tuple(problems)
