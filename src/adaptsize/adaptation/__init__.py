"""One adaptation cycle: estimate, size, limit, remesh, transfer."""

from adaptsize.adaptation.api import AdaptResult, adapt
from adaptsize.adaptation.report import AdaptReport
from adaptsize.adaptation.transfer import FieldTransfer, TransferredFields, transfer_fields

__all__ = [
    "AdaptReport",
    "AdaptResult",
    "FieldTransfer",
    "TransferredFields",
    "adapt",
    "transfer_fields",
]
