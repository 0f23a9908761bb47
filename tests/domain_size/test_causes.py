"""The table of causes: what is reported, what codes stand for, what own sizes of parts replace."""

import numpy as np
import pytest
from domains import l_shape
from numpy.testing import assert_array_equal
from shapes import two_region_rectangle
from solids import box

from adaptsize import PointSource, size_function
from adaptsize._causes import CAUSES
from adaptsize.domain_size.surface_bounds import BOUNDS

BY_NAME = {cause.name: cause for cause in CAUSES}


def test_names_and_codes_are_of_one_cause():
    assert len({cause.name for cause in CAUSES}) == len(CAUSES)
    assert sorted(cause.code for cause in CAUSES) == list(range(len(CAUSES)))
    assert {bound.cause for bound in BOUNDS} < {*CAUSES}


@pytest.mark.parametrize("kind", ["mesh", "surface"])
def test_reports_have_causes_of_the_table_in_order_of_the_request(kind):
    domain = l_shape(60)[0] if kind == "mesh" else box(2.0, 1.0, 0.3)
    source = PointSource([domain.points[:3].mean(axis=0)], 0.02 * domain.diameter)
    size = size_function(domain, sources=[source], h0=lambda x: np.full(len(x), domain.diameter))
    causes = [BY_NAME[name] for name in size.report.causes]
    assert [cause.name for cause in causes[-2:]] == ["hmin", "hmax"]
    codes = np.append([cause.code for cause in causes], -1)
    assert_array_equal(size.report.cause_codes(), codes[size.report.cause])


def test_own_sizes_of_a_part_replace_bounds_of_its_shape_only():
    mesh = two_region_rectangle(4)
    given = {
        "sources": [PointSource([[0.1, 0.1]], 0.01)],
        "h0": np.full(mesh.n_points, 0.3),
        "elements_across": 8,
        "hmin": 1e-3,
    }
    first = np.unique(mesh.cell_tags)[0]
    before = size_function(mesh, **given).report
    after = size_function(mesh, size_of={f"region {first}": 0.2}, **given).report
    own = np.isfinite(after.bounds["size_of"])
    assert own.any()
    assert not own.all()
    assert {"width", "sources", "h0"} < {*before.bounds}
    for name, bound in before.bounds.items():
        is_replaced = BY_NAME[name].is_of_shape
        expected = np.where(own & is_replaced, np.inf, bound)
        assert_array_equal(after.bounds[name], expected)
