"""What the battery does, and what is believed about it."""

from bms.belief import SocBelief
from bms.errors import BatteryError
from bms.library import load_pack, pack_names
from bms.ocv import OcvCurve
from bms.pack import Pack
from bms.piecewise import PiecewiseLinear
from bms.uncertainty import UncertaintyModel
from gpc.kernel_cache import provide_folder

__all__ = [
    "BatteryError",
    "OcvCurve",
    "Pack",
    "PiecewiseLinear",
    "SocBelief",
    "UncertaintyModel",
    "load_pack",
    "pack_names",
]

provide_folder()
