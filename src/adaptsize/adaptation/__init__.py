"""One adaptation cycle: estimate, size, limit, remesh, transfer."""

from adaptsize.adaptation.cycle import adapt
from adaptsize.adaptation.element_fields import ElementField, QuadratureField, element_nodes
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.need import needs_remeshing
from adaptsize.adaptation.state import read_state, write_state
from adaptsize.adaptation.transfer import transfer_fields

__all__ = [
    "ElementField",
    "FieldTransfer",
    "QuadratureField",
    "adapt",
    "element_nodes",
    "needs_remeshing",
    "read_state",
    "transfer_fields",
    "write_state",
]
