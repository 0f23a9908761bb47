"""One adaptation cycle: estimate, size, limit, remesh, transfer."""

from adaptsize.adaptation.api import adapt
from adaptsize.adaptation.report import AdaptReport
from adaptsize.adaptation.result import AdaptResult
from adaptsize.adaptation.transfer import FieldTransfer, TransferredFields, transfer_fields

__all__ = [
    "AdaptReport",
    "AdaptResult",
    "FieldTransfer",
    "TransferredFields",
    "adapt",
    "transfer_fields",
]
