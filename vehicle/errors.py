"""The one exception that this package raises for bad input."""


class VehicleError(ValueError):
    """Bad vehicle data, or a cycle that the vehicle model cannot be asked to follow."""
