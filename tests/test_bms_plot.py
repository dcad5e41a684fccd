"""Pictures of the packs."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

from bms import load_pack
from bms.plot import plot_alpha, plot_ocv


def test_importing_the_plots_leaves_matplotlib_out():
    code = "import sys, bms, bms.plot; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_ocv_is_drawn_in_per_cent_and_volt(tmp_path):
    battery = load_pack("hev")
    ax = plot_ocv(battery)
    soc, voltage = (np.asarray(values) for values in ax.lines[0].get_data())
    assert (soc[0], soc[-1]) == (0.0, 100.0)
    assert voltage[0] == battery.ocv_V[0]
    assert voltage[-1] == pytest.approx(battery.ocv_V[-1])
    np.testing.assert_allclose(ax.lines[1].get_ydata(), battery.ocv_V)
    assert ax.get_xlabel() == "SOC [%]"
    assert ax.get_ylabel() == "open-circuit voltage [V]"
    picture = tmp_path / "ocv.png"
    ax.figure.savefig(picture)
    assert picture.stat().st_size > 5000


def test_packs_share_the_given_axes():
    ax = Figure().subplots()
    for name in ("hev", "phev"):
        assert plot_alpha(load_pack(name), ax) is ax
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["hev", "phev"]
    assert max(np.asarray(ax.lines[0].get_ydata())) == pytest.approx(1.0, abs=1e-3)
    assert ax.get_ylabel() == "alpha [-]"
