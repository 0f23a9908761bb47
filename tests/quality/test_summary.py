"""Summary of a mesh: names of tags."""

import json

from adaptsize import SimplexMesh
from adaptsize.quality.summary import summarize

NAMED = SimplexMesh(
    [[0, 0], [1, 0], [1, 1], [0, 1]],
    [[0, 1, 2], [0, 2, 3]],
    cell_tags=[1, 4],
    tagged_facets=[[0, 1], [1, 2], [2, 3]],
    facet_tags=[7, 4, 7],
    tag_names={(2, 4): "fluid", (1, 7): "hot wall", (1, 9): "nowhere"},
)


def test_names_of_tags_stand_beside_the_tags_of_their_dimension():
    summary = summarize(NAMED)
    lines = str(summary).splitlines()
    assert 'cell tags    1 (1), 4 "fluid" (1)' in lines
    assert 'facet tags   4 (1), 7 "hot wall" (2)' in lines
    found = json.loads(json.dumps(summary.as_dict()))
    assert found["cell_tag_names"] == {"4": "fluid"}
    assert found["facet_tag_names"] == {"7": "hot wall"}
