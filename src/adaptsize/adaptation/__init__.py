"""One adaptation cycle: estimate, size, limit, remesh, transfer."""

from adaptsize.adaptation.cycle import adapt
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.given_fields import ElementField, QuadratureField
from adaptsize.adaptation.need import needs_remeshing
from adaptsize.adaptation.state import LoopState
from adaptsize.adaptation.transfer import transfer_fields

__all__ = [
    "ElementField",
    "FieldTransfer",
    "LoopState",
    "QuadratureField",
    "adapt",
    "needs_remeshing",
    "transfer_fields",
]
