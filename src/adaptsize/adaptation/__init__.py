"""One adaptation cycle: estimate, size, limit, remesh, transfer."""

from adaptsize.adaptation.api import adapt
from adaptsize.adaptation.report import AdaptReport
from adaptsize.adaptation.result import AdaptResult
from adaptsize.adaptation.transfer import FieldTransfer, transfer_fields
from adaptsize.adaptation.transfer_in_parts import TransferredFields

__all__ = [
    "AdaptReport",
    "AdaptResult",
    "FieldTransfer",
    "TransferredFields",
    "adapt",
    "transfer_fields",
]
