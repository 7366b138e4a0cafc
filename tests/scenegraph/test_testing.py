"""The contract of stages: one that hides a single visible drawable and promises to lose nothing is found out."""

from __future__ import annotations

import pytest

from scenegraph import Frame, Guarantee, Stage
from scenegraph.testing import StageContract


class Loses(Stage):
    """Hides one drawable of each view."""

    name = "loses"
    guarantee = Guarantee.CONSERVATIVE

    def run(self, frame: Frame) -> None:
        frame.hide(frame.candidates()[-1:])


class Admits(Loses):
    """Does the same, and says so."""

    name = "admits"
    guarantee = Guarantee.AGGRESSIVE
    bound = "one drawable"


class Keeps(Stage):
    """Hides nothing."""

    name = "keeps"
    guarantee = Guarantee.CONSERVATIVE

    def run(self, frame: Frame) -> None:
        """Nothing."""


@pytest.mark.gl
def test_a_false_promise_is_found_by_the_exact_visible_set() -> None:
    contract = StageContract()
    with pytest.raises(AssertionError, match="hidden though visible"):
        contract.test_conservative_claims_hold_against_the_truth(Loses())
    with pytest.raises(pytest.skip.Exception, match="measured, not forbidden"):
        contract.test_conservative_claims_hold_against_the_truth(Admits())
    contract.test_conservative_claims_hold_against_the_truth(Keeps())


def test_a_false_promise_is_found_without_opengl() -> None:
    contract = StageContract()
    with pytest.raises(AssertionError):
        contract.test_one_drawable_in_front_of_the_eye_is_kept(Loses())
    contract.test_one_drawable_in_front_of_the_eye_is_kept(Keeps())
