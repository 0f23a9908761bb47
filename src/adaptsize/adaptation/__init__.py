"""One adaptation cycle: estimate, size, limit, remesh, transfer."""

from adaptsize.adaptation.report import AdaptReport
from adaptsize.adaptation.transfer import FieldTransfer, TransferredFields, transfer_fields
from adaptsize.adaptation.turn import AdaptResult, adapt

__all__ = [
    "AdaptReport",
    "AdaptResult",
    "FieldTransfer",
    "TransferredFields",
    "adapt",
    "transfer_fields",
]
