"""Mass, inertia and centre of gravity of a vehicle, estimated while driving ([M] parts 1 and 2)."""

from gpc.kernel_cache import provide_folder

provide_folder()
