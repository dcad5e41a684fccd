"""What the road and the driver demand of a powertrain, and what each torque split costs."""

from vehicle.chassis import Chassis, Demand
from vehicle.engine import Engine
from vehicle.errors import VehicleError
from vehicle.gearbox import Gearbox
from vehicle.library import load_vehicle, vehicle_names
from vehicle.motor import Motor
from vehicle.powertrain import ControlTable, Infeasible, Vehicle

__all__ = [
    "Chassis",
    "ControlTable",
    "Demand",
    "Engine",
    "Gearbox",
    "Infeasible",
    "Motor",
    "Vehicle",
    "VehicleError",
    "load_vehicle",
    "vehicle_names",
]
