"""What is known not to reproduce, or not to hold, and why: of tables, figures, and what is said of them.

An item may have every row within its tolerance and stand here all the same, because the tolerance had to be
wide, the data behind the original are not public, or a sentence of the source does not follow from it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Shortfall:
    """One thing that does not reproduce.

    Parameters
    ----------
    items : tuple of str
        Ids of the tables and figures that it is about.
    what : str
        What does not reproduce.
    reason : str
        Why.
    """

    items: tuple[str, ...]
    what: str
    reason: str


@dataclass(frozen=True)
class Omitted:
    """A table or a figure of a source that is not reproduced at all.

    Parameters
    ----------
    id : str
        As the ids of what is.
    title : str
        What it shows.
    reason : str
        Why there is nothing to compute.
    """

    id: str
    title: str
    reason: str


def _figures(first: int, last: int) -> tuple[str, ...]:
    return tuple(f"mautc-fig{number}" for number in range(first, last + 1))


def _tables(first: int, last: int) -> tuple[str, ...]:
    return tuple(f"mautc-table{number}" for number in range(first, last + 1))


SHORTFALLS = (
    Shortfall(
        ("larsson-table2",),
        "The PHEV burns more than published, and the fuel of both concepts rises less with mu.",
        "Engine and motor maps, altitude and penalties are not published; ours are own choices, and the "
        "penalties decide how much uncertainty costs. One realization of the PHEV scatters by about 0.46 "
        "l/100 km, because the noise of the model creates energy: a mean of 50, as published, has a "
        "standard error of about 0.065, as large as the published rise. Of some thirty penalties tried, "
        "none gave both the published final SOC and a rise of the PHEV's fuel above 1.5 %.",
    ),
    Shortfall(
        ("larsson-fig8",),
        "“The EMS reduces the battery current in order to end with a more precise estimate” is not the "
        "main reason why the uncertainty falls towards the end.",
        "On the same stretch of road one lap earlier, where nothing ends, current and uncertainty are "
        "nearly as low: most of the fall is the road, and the low SOC, at which the voltage says more.",
    ),
    Shortfall(
        ("larsson-fig1", "larsson-fig4", "larsson-fig5"),
        "The curves themselves: open-circuit voltage, penalties, altitude.",
        "The paper draws them and gives no numbers. Ours are own choices with the properties that it "
        "describes.",
    ),
    Shortfall(
        ("mautc-table1", "mautc-table2", *_figures(1, 6)),
        "The tracks of the mass-spring system, and the recipe of Table 2 as printed.",
        "Stiffness, true mass, noise and duration are not given. A scatter of ±3, as printed, does not "
        "reach a state that is 15 off: it takes ±15. The covariance of the literal recipe means nothing "
        "either way.",
    ),
    Shortfall(
        ("mautc-table3", "mautc-table4", *_figures(7, 14)),
        "4 collocation points, and “RLS cannot handle noise”.",
        "15 terms need at least 15 points. Least squares is biased in the form whose regressor is the "
        "noisy acceleration, and as good as any filter in the other; the report does not say which it "
        "used. Its vehicle, road and manoeuvres are not given.",
    ),
    Shortfall(
        ("mautc-table5", "mautc-table6", *_figures(17, 22)),
        "The road tests.",
        "Their logs are not public, and an error of one drive can only be compared in size. Drives are "
        "synthetic, with the true values that Tables 5 and 6 imply; the errors are those that sensors "
        "with a gain error of 1 % leave. C is not identifiable, the report's own value is incorrect as it "
        "says, and its 2.57 % in Table 6 is 2.51 %.",
    ),
    Shortfall(
        ("mautc-fig25",),
        "The lower end of the voltage, 2.2 V, and a polynomial of 6th order that serves from 10 to 90 %.",
        "The curve is drawn only; ours comes from electrode potentials of the literature and ends at 2.5 "
        "V. Its polynomial falls near the upper end of the range, where two SOCs share a voltage.",
    ),
    Shortfall(
        ("mautc-fig26", "mautc-fig27", "mautc-fig28"),
        "The measured pulses, and the current of the report's car.",
        "The pulses are drawn only, the power-split car and its policy are not given. Pulses are "
        "simulated; the car is the PHEV of Larsson et al., its current scaled to the report's pack.",
    ),
    Shortfall(
        ("mautc-fig31",),
        "“A sudden drop” of the SOC error when the estimator is switched on.",
        "The drop takes about an hour, and half a per cent is reached on the second day: the gains of "
        "Table 8 allow no more, and one of the capacitances overshoots meanwhile.",
    ),
    Shortfall(
        ("mautc-fig32", "mautc-fig33"),
        "The degradation map.",
        "It is drawn only, over current and voltage. Ours adds two published laws for the same cell, over "
        "current and SOC. Real fade is not too slow for the estimator: the acceleration only makes it "
        "easier to see.",
    ),
    Shortfall(
        ("mautc-table17",),
        "One of 556 numbers in Tables 9 to 20: the error of 5 antithetic runs at location 1, 0.00233 mph.",
        "It is 0.00206. The report does not name its draws, but its tables tell them: those of Microsoft's "
        "rand(), unseeded, by Box-Muller with pi as 3.14. All plain errors and means follow to 0.01 %, "
        "antithetic errors to 0.0003 mph, which looks like rounding and shows in the smallest.",
    ),
    Shortfall(
        _figures(38, 40),
        "Scenarios slow down “at the same time” at locations 1 to 3.",
        "The front travels at nearly the free-flow speed, which differs between draws, so the times part "
        "in proportion to distance.",
    ),
    Shortfall(
        ("mautc-table11", "mautc-table12", *_tables(17, 20), *_figures(42, 49)),
        "Underwood is “marginally different” from Greenshields, and antithetic sampling gives “similar "
        "results”.",
        "Underwood's capacity, 1,380 vehicles per hour, is below the demand of 2,400. The report's scheme "
        "lets all of it in, jams the first cell, and the road ahead empties: its “free flow” is an empty "
        "road. A scheme that lets in what there is room for gives half the speed.",
    ),
    Shortfall(
        ("mautc-fig50",),
        "5 antithetic runs have 10 % of the error of 100 plain ones.",
        "By the report's own numbers that holds in 5 of its 16 entries, rounded to whole per cent. At "
        "equal numbers of runs antithetic errors are smaller in all.",
    ),
)

OMITTED = (
    Omitted("larsson-fig3", "configuration of the powertrain", "A drawing; nothing is computed."),
    Omitted("mautc-fig15", "diagram of the vehicle model", "A drawing; nothing is computed."),
    Omitted("mautc-fig16", "instrumented Land Rover", "A photograph."),
    Omitted("mautc-fig23", "equivalent circuit of the battery", "A circuit diagram; nothing is computed."),
    Omitted("mautc-fig24", "test bench of the battery", "A photograph."),
    Omitted("mautc-fig29", "simulation of the estimator", "A block diagram; nothing is computed."),
)


def shortfalls_of(item: str) -> tuple[Shortfall, ...]:
    """Return what is known not to reproduce of an item.

    Parameters
    ----------
    item : str
        Its id.
    """
    return tuple(one for one in SHORTFALLS if item in one.items)
