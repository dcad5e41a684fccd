"""A folder of results: replaced as a whole or not at all, and read back as the records it came from."""

from socwise.results.netcdf import read_case, write_case
from socwise.results.reading import StoredComparison, read
from socwise.results.result import Result
from socwise.results.staging import StoreError, check_writable

__all__ = ["Result", "StoreError", "StoredComparison", "check_writable", "read", "read_case", "write_case"]
