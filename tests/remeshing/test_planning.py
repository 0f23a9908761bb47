"""Which routes are planned, and in which order, from what is known beforehand."""

from dataclasses import replace

import pytest

from adaptsize.remeshing.planning import Known, plan

SURFACE = Known(
    "surface to tetrahedra", ("mmg", "tetwild"), True, 40_000, 2_000, 1e-3, can_fill=True,
    is_closed=True,
)  # fmt: skip
ADAPTED, GIVEN = "netgen on the adapted surface, then mmg", "netgen, then mmg"
ALONE, AGAIN, ON_TETWILD = "tetwild", "tetwild with 0.25 x tolerance", "tetwild, then mmg"
UNSIZED = "tetwild without sizes"


def names(known, **options):
    return [str(attempt) for attempt in plan(known, **options)]


@pytest.mark.parametrize(
    ("known", "expected", "reason"),
    [
        ({}, [ADAPTED, GIVEN, ALONE, AGAIN, ON_TETWILD], "closed and does not cross itself"),
        ({"is_crossed": True}, [ALONE, AGAIN, UNSIZED], "cross others: fTetWild makes the"),
        ({"can_fill": False}, [ALONE, AGAIN, ON_TETWILD], "Netgen is not installed, or"),
        (
            {"can_fill": False, "is_closed": False},
            [ALONE, AGAIN, ON_TETWILD],
            "the surface is open: fTetWild decides",
        ),
        ({"generators": ("tetwild",), "needs_volume": False}, [ALONE, AGAIN], "without a first"),
        ({"tolerance": 0.2, "is_crossed": True}, [ALONE, UNSIZED], "fTetWild makes the union"),
        (
            {"generators": ("mmg", "tetwild", "mine")},
            [ADAPTED, GIVEN, ALONE, AGAIN, ON_TETWILD, "mine"],
            "closed",
        ),
    ],
)
def test_the_route_follows_from_what_is_known(known, expected, reason):
    attempts = plan(replace(SURFACE, **known))
    assert [str(attempt) for attempt in attempts] == expected
    assert reason in attempts[0].reason
    assert all(attempt.reason for attempt in attempts)
    # Repetitions are for failures only; fTetWild is for faults of a mesh, too.
    for attempt in attempts[1:]:
        assert bool(attempt.cures) == (str(attempt) in (ALONE, ON_TETWILD))
        assert ("boundary" in attempt.cures) == (str(attempt) == ALONE)
    before = [str(attempt) for attempt in attempts].index(ALONE)
    assert [attempt.is_followed for attempt in attempts] == [
        number < before for number in range(len(attempts))
    ]


@pytest.mark.parametrize("task", ["tetrahedra", "plane triangles", "surface"])
def test_other_meshes_go_to_the_generators_in_their_order(task):
    known = replace(SURFACE, task=task, generators=("mine", "tetwild"))
    assert names(known) == ["mine", "tetwild"]
    assert names(replace(known, generators=("mine",))) == ["mine"]


def test_tetrahedra_that_overlap_are_made_anew_first():
    known = replace(SURFACE, task="tetrahedra")
    anew = "netgen in each region, then mmg"
    usual, folded = plan(known), plan(replace(known, is_folded=True))
    assert [str(attempt) for attempt in usual] == ["mmg", anew, "tetwild"]
    assert [str(attempt) for attempt in folded] == [anew, "mmg", "tetwild"]
    assert "inside out" in folded[0].reason
    assert [bool(attempt.cures) for attempt in usual] == [True, False, True]
    assert [bool(attempt.cures) for attempt in folded] == [True, False, True]


def test_only_strict_tries_smaller_tolerances():
    assert names(SURFACE, strict=True) == [
        ADAPTED, GIVEN, f"{ADAPTED} with 0.4 x tolerance", ALONE, AGAIN,
        f"{ALONE} with 0.4 x tolerance", ON_TETWILD, f"{ADAPTED} with 0.15 x tolerance",
    ]  # fmt: skip
    known = replace(SURFACE, task="surface", generators=("mmg",))
    tolerances = [attempt.factor for attempt in plan(known, strict=True)]
    assert tolerances == [1.0, 0.4, 0.15]


@pytest.mark.parametrize("known", [SURFACE, replace(SURFACE, is_crossed=True)])
def test_the_useful_time_grows_with_the_number_of_cells_and_facets(known):
    few, many = plan(known), plan(replace(known, n_cells=1e6, n_given=5e5))
    for one, other in zip(few, many, strict=True):
        assert 5.0 * one.seconds < other.seconds
    # Parts of 40 000 elements get an answer within five minutes, also if the first routes fail.
    last = [str(attempt) for attempt in few].index(ALONE)
    assert sum(attempt.seconds for attempt in few[: last + 1]) < 300.0


def test_a_fine_given_surface_takes_time_whatever_the_sizes():
    coarse, fine = plan(SURFACE), plan(replace(SURFACE, n_given=10 * int(SURFACE.n_cells)))
    for one, other in zip(coarse, fine, strict=True):
        assert 1.5 * one.seconds < other.seconds
