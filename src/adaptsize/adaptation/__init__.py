"""One adaptation cycle: estimate, size, limit, remesh, transfer."""

from adaptsize.adaptation.cycle import AdaptResult, adapt
from adaptsize.adaptation.need import Place, RemeshingNeed, needs_remeshing
from adaptsize.adaptation.report import AdaptReport
from adaptsize.adaptation.transfer import FieldTransfer, transfer_fields
from adaptsize.adaptation.transfer_in_parts import TransferredFields

__all__ = [
    "AdaptReport",
    "AdaptResult",
    "FieldTransfer",
    "Place",
    "RemeshingNeed",
    "TransferredFields",
    "adapt",
    "needs_remeshing",
    "transfer_fields",
]
