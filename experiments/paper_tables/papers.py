"""What the three papers show, table by table and figure by figure, and what of ours stands against it.

As far as the project has notes on the papers; `experiments.page` makes the page of it.
"""

from dataclasses import dataclass

from experiments.results import Table


@dataclass(frozen=True)
class Quote:
    """Cells of one row of a table.

    Attributes:
        text: with a `{}` for every cell.
        table: title, as in `Results.tables`.
        row: the cells that the row begins with.
        columns: of the cells.
    """

    text: str
    table: str
    row: tuple[str, ...]
    columns: tuple[str, ...]

    def read(self, tables: dict[str, Table]) -> str:
        """The text with the numbers in it.

        Raises:
            KeyError: the results have no such table, row or column.
        """
        row = tables[self.table].row(self.row)
        return self.text.format(*(row[column] for column in self.columns))


@dataclass(frozen=True)
class Gain:
    """By how many per cent the mean of one column is over that of another.

    Attributes:
        text: with a `{}` for the per cent.
        table: title, as in `Results.tables`.
        over, under: the columns.
    """

    text: str
    table: str
    over: str
    under: str

    def read(self, tables: dict[str, Table]) -> str:
        """The text with the number in it.

        Raises:
            KeyError: the results have no such table or column.
        """
        rows = [tables[self.table].row(row[:1]) for row in tables[self.table].rows]
        over, under = (sum(float(row[column]) for row in rows) for column in (self.over, self.under))
        return self.text.format(f"{100 * (over / under - 1):+.2f} %")


@dataclass(frozen=True)
class Item:
    """A table, a figure or a number of a paper.

    Attributes:
        name: in the paper.
        shows: what there is to see, with the paper's numbers.
        ours: the numbers that stand against it.
        files: of the experiment's results that show it.
    """

    name: str
    shows: str
    ours: tuple[Quote | Gain, ...]
    files: tuple[str, ...] = ("table.md",)


@dataclass(frozen=True)
class Paper:
    """A paper.

    Attributes:
        name: short.
        title: what it is about.
        experiment: that puts its claims to the test.
        note: on the paper's numbers.
        items: everything that it shows.
    """

    name: str
    title: str
    experiment: str
    note: str
    items: tuple[Item, ...]


_POSE = ("position RMSE, m", "heading RMSE, °")
_CLOUD = ("particles around the truth, m", "spread, m")


def _hall(world: str, size: str, maps: str, curves: str) -> tuple[Item, ...]:
    """A hall's two figures: maps, and errors over time with the particles below them."""
    compared, equal = f"{world}: Methods", f"{world}: At an equal number of evaluations"
    methods = {
        "15 improved": ("improved", "15"),
        "30 traditional": ("traditional RBPF", "30"),
        "30 of scan matching as gmapping": ("scan matching as gmapping", "30"),
    }
    two = {name: methods[name] for name in ("15 improved", "30 traditional")}
    equals = {
        "6 improved, as one swarm": ("improved, the particles as one swarm", "6"),
        "510 traditional": ("traditional RBPF", "510"),
    }
    return (
        Item(
            maps,
            f"Maps of the hall of {size}, by 30 traditional particles and by 15 improved ones. No numbers",
            tuple(
                Quote(f"{name}: IoU of walls {{}}", compared, row, ("IoU of walls (worst)",))
                for name, row in two.items()
            ),
            (f"{world}-maps.png",),
        ),
        Item(
            f"{curves}, error over time",
            f"Error in position and heading over 200 s in the hall of {size}. Curves without numbers",
            tuple(Quote(f"{name}: {{}} m, {{}}°", compared, row, _POSE) for name, row in methods.items())
            + tuple(
                Quote(f"at 510 evaluations per scan, {name}: {{}} m, {{}}°", equal, row, _POSE)
                for name, row in equals.items()
            ),
            (f"{world}-errors.png",),
        ),
        Item(
            f"{curves}, particles",
            f"Particles around the true pose after filtering, in the hall of {size}. No numbers",
            tuple(
                Quote(f"{name}: {{}} m around the truth, {{}} m around their mean", compared, row, _CLOUD)
                for name, row in methods.items()
            ),
            (f"{world}-clouds.png",),
        ),
    )


TOBACCO = Paper(
    "tobacco",
    "The improved filter: EKF fusion, ICP and fruit flies",
    "tobacco_line",
    "The paper says that 15 particles of the improved filter do what 30 of the traditional one do. It prints "
    "curves and pictures without numbers: ours can be held against each other, and not against its own.",
    _hall("hall_small", "18 × 15 m", "Figure 4", "Figure 5")
    + _hall("hall_large", "24 × 23 m", "Figure 6", "Figure 7"),
)


def _distortion(name: str, row: tuple[str, ...]) -> Quote:
    columns = ("position RMSE, m", "length error, m", "width error, m")
    return Quote(f"{name}: position {{}} m, length {{}} m, width {{}} m", "Mapping", row, columns)


def _found(name: str, task: str, which: str) -> Quote:
    text = f"{name}, {which} map: {{}} found; updates (median, worst) {{}}"
    columns = ("found at the end", "updates until found: median, worst")
    return Quote(text, "Localisation", (task, which), columns)


def _tracked(which: str) -> Quote:
    columns = ("error when tracked, m",)
    return Quote(f"tracked, {which} map: {{}} m", "Localisation", ("tracking", which), columns)


_TRADITIONAL, _OPTIMISED = "traditional FastSLAM", "optimised FastSLAM"

MINE = Paper(
    "mine",
    "AMCL and the optimised FastSLAM in a coal-mine roadway",
    "coal_mine",
    "The paper's claims come without numbers in our notes: that the traditional filter distorts the map of a "
    "roadway, that the optimised one does not with fewer particles, and that AMCL localises there.",
    (
        Item(
            "Figures 7 and 8",
            "The roadway mapped by traditional FastSLAM, distorted, and by the optimised one, straight",
            tuple(
                Quote(f"{name}: IoU of walls {{}}", "Mapping", row, ("IoU of walls (worst)",))
                for name, row in (
                    ("30 traditional", (_TRADITIONAL, "30")),
                    ("15 optimised", (_OPTIMISED, "15")),
                )
            ),
            ("maps.png",),
        ),
        Item(
            "Distortion over particle numbers",
            "The optimised filter needs fewer particles for a map that is not distorted",
            tuple(
                _distortion(f"{count} {name}", (method, count))
                for name, method, counts in (
                    ("traditional", _TRADITIONAL, ("15", "30", "100", "300")),
                    ("optimised", _OPTIMISED, ("5", "15", "30")),
                )
                for count in counts
            ),
            ("table.md", "particles.png"),
        ),
        Item(
            "AMCL (8–15)",
            "A robot localises itself in the known map of the roadway",
            (
                _tracked("true"),
                _tracked("built"),
                _found("global start", "global", "true"),
                _found("global start", "global", "built"),
                _found("kidnapped", "kidnapped", "true"),
                _found("kidnapped", "kidnapped", "built"),
            ),
            ("table.md", "localisation.png"),
        ),
    ),
)

_LOOPS = "Table II, the worst device of the data sheet"
_FIGURES = "The same in figures"
TABLE_II = {
    "30": ("0/10", "53", "10/10", "58"),
    "100": ("4/10", "47.9", "10/10", "58.3"),
    "200": ("6/10", "48.5", "10/10", "61.6"),
    "400": ("10/10", "46.9", "10/10", "67.8"),
}
"""The third paper's, by particles: loops closed and inliers, without and with the network."""


def _loops(count: str) -> Item:
    without, inliers_without, closed, inliers = TABLE_II[count]
    return Item(
        f"Table II, {count} particles",
        f"Without the network {without} loops closed, {inliers_without} inliers; with it {closed}, {inliers}",
        (
            Quote(
                "without {} closed, {} inliers ({} against known poses)",
                _LOOPS,
                (count,),
                ("closed without", "inliers without", "inliers of known poses without"),
            ),
            Quote(
                "with {} closed, {} inliers ({} against known poses)",
                _LOOPS,
                (count,),
                ("with", "with (2)", "with (3)"),
            ),
        ),
    )


def _with_and_without(text: str, *columns: str) -> tuple[Quote, ...]:
    return tuple(
        Quote(f"{net} it, {count} particles: {text}", _FIGURES, (net, count), columns)
        for net in ("without", "with")
        for count in TABLE_II
    )


ANN = Paper(
    "ann",
    "A neural network corrects a cheap lidar",
    "range_network",
    "The paper drove a TurtleBot3; ours is a simulated corridor of the same size, and a lidar as bad as its "
    "data sheet allows. Inliers depend on the features and on the map they are counted in, so compare "
    "differences and not sizes.",
    (
        Item(
            "Training",
            "50 tanh neurons by Levenberg–Marquardt: MSE 9.55e-5 m² at the distances it was shown",
            (
                Quote(
                    "MSE {} m² at the distances it was shown; {} mm RMSE at held-out ones, {} mm before",
                    "Training",
                    ("levenberg-marquardt",),
                    ("MSE at learnt distances, m²", "RMSE at held-out, mm", "raw there, mm"),
                ),
                Quote(
                    "by Adam: MSE {} m²; {} mm RMSE at held-out distances",
                    "Training",
                    ("adam",),
                    ("MSE at learnt distances, m²", "RMSE at held-out, mm"),
                ),
            ),
            ("table.md", "training/training.png", "training/training.json"),
        ),
        Item(
            "Figures 8 to 13",
            "Readings against the truth, their errors, histograms at 1 m and 3 m, and standard deviations by "
            "distance. Curves without numbers",
            (
                Quote(
                    "at held-out distances {} mm RMSE before, {} after, of which noise {}",
                    "Training",
                    ("levenberg-marquardt",),
                    ("raw there, mm", "RMSE at held-out, mm", "noise there, mm"),
                ),
            ),
            tuple(f"training/{name}.png" for name in ("readings", "errors", "histograms", "deviations")),
        ),
        *(_loops(count) for count in TABLE_II),
        Item(
            "Inliers overall",
            "+25.17 % with the network, from the means over table II",
            (
                Gain("{} with the network", _LOOPS, "with (2)", "inliers without"),
                Gain("{} against known poses", _LOOPS, "with (3)", "inliers of known poses without"),
            ),
        ),
        Item(
            "Size of the map",
            "15.7 × 42.6 m without the network, 15.95 × 43.10 m with it; true 15.9 × 43 m",
            _with_and_without("{} m", "map, m"),
        ),
        Item(
            "Cost",
            "The CPU's load, without numbers in our notes",
            _with_and_without("{} ms per scan, {} s of CPU time", "ms per scan", "CPU seconds"),
        ),
        Item(
            "Figures 14 to 19",
            "Maps of the corridor: the ground truth, without the network and with it",
            _with_and_without("walls drawn once {}", "walls drawn once"),
            ("maps.png",),
        ),
    ),
)

PAPERS = (TOBACCO, MINE, ANN)
