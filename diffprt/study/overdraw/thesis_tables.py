"""The numbers of the 2005 thesis's chapter 5, as printed.

Its "our method" is not one method. In the tables of the Dino the error rises by 42 to 127 % with it, so clusters were
formed with geometry coherence; in those of the Horse and the Bunny it stays within 1 % of the original while overdraw
falls, so the clusters are the original ones, grouped into super-clusters. Squared errors depend on the scale of BRDF
and light, which the thesis does not give: only their ratios within a table can be set beside others.

Source: Chen 2005 (thesis), tables 5.2 to 5.17; 5.1 lists its meshes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

ORIGINAL = "original CPCA"
REDUCED = "overdraw reduction"
OURS = "its own"
REDUCED_OURS = "overdraw reduction + its own"

# The registers that section 4.3 computes with.
REGISTERS = 256


@dataclass(frozen=True)
class ThesisRow:
    """One line of a table.

    Attributes:
        method: `ORIGINAL`, `REDUCED`, `OURS` or `REDUCED_OURS`.
        seconds: of clustering, on a Pentium IV at 3.4 GHz.
        overdraw: average triangle overdraw.
        frames: per second, on a GeForce 6800 GT at 1280 x 948.
        squared_error: average.
    """

    method: str
    seconds: int
    overdraw: float
    frames: float
    squared_error: float


@dataclass(frozen=True)
class ThesisTable:
    """Table 5.`number`: a model and BRDF at one number of clusters; alpha is 0.05 in all of them."""

    number: int
    model: str
    brdf: str
    clusters: int
    rows: tuple[ThesisRow, ...]

    def row(self, method: str) -> ThesisRow | None:
        """Of a method; None where the table lacks it, as those of the Dino lack `REDUCED_OURS`."""
        return next((row for row in self.rows if row.method == method), None)


_METHODS = (ORIGINAL, REDUCED, OURS, REDUCED_OURS)
# Table, model, BRDF, clusters; then for each of `_METHODS` in turn seconds, overdraw, frames and squared error.
_PRINTED = """
2   Dino   phong          64     233  1.427584   27.57  0.033846
                                 342  1.383141   28.12  0.032895
                                 138  1.309619   32.37  0.047968
3   Dino   phong          256   1624  1.733425   22.93  0.005371
                                1647  1.646063   24.43  0.006344
                                 451  1.40481    30.52  0.012216
4   Dino   phong          128    758  1.556363   26.58  0.014452
                                 737  1.505114   27.15  0.014756
                                 250  1.359051   31.91  0.027246
5   Dino   phong          192    915  1.637316   24.62  0.007938
                                1186  1.593019   25.6   0.008764
                                 295  1.382953   30.89  0.017335
6   Horse  phong          64     226  1.510882   27.7   0.029795
                                 259  1.449997   29.38  0.029944
                                 344  1.417578   30.51  0.029789
                                 270  1.344148   32.11  0.030263
7   Horse  phong          256    960  1.825407   25.18  0.00634
                                1016  1.724545   27.7   0.007333
                                1217  1.632803   30.03  0.006301
                                 820  1.574815   32.54  0.007226
8   Horse  phong          128    700  1.664971   26.75  0.014491
                                 466  1.59935    28.49  0.016006
                                 958  1.506927   31.23  0.014509
                                 369  1.474205   32.47  0.015547
9   Horse  phong          192    831  1.739609   25.43  0.009147
                                 766  1.673963   27.06  0.009875
                                1077  1.570583   30.32  0.009132
                                 834  1.511764   31.16  0.010184
10  Horse  cook-torrance  64     215  1.518691   27.75  0.258778
                                 258  1.469621   29.06  0.255928
                                 319  1.408963   31.02  0.258831
                                 184  1.378961   31.59  0.259388
11  Horse  cook-torrance  256    863  1.799159   25.32  0.064937
                                1016  1.755126   26.41  0.069018
                                1085  1.640612   30.01  0.064994
                                1157  1.592372   32.33  0.064323
12  Horse  cook-torrance  128    434  1.643282   26.64  0.136315
                                 489  1.608796   27.45  0.137434
                                 621  1.519724   30.04  0.136325
                                 562  1.457983   31.62  0.136876
13  Horse  cook-torrance  192    648  1.729105   25.76  0.089433
                                 624  1.696131   26.58  0.093385
                                 843  1.584186   30.01  0.089484
                                 724  1.560885   30.24  0.092139
14  Bunny  cook-torrance  256   1609  1.529308   23.05  0.054466
                                1886  1.467294   24.45  0.058319
                                2293  1.413759   25.89  0.054501
                                2087  1.378627   26.77  0.055894
15  Bunny  cook-torrance  64     340  1.30541    25.86  0.221043
                                 438  1.275172   26.67  0.224016
                                 606  1.239781   27.72  0.221096
                                 434  1.207974   28.53  0.225144
16  Bunny  cook-torrance  128    766  1.412708   25.07  0.118658
                                 908  1.345726   26.65  0.117374
                                1179  1.300917   27.61  0.118617
                                1037  1.285856   28.16  0.113184
17  Bunny  cook-torrance  192   1339  1.471411   24.65  0.073271
                                1165  1.420354   25.89  0.076507
                                1912  1.356309   27.49  0.07328
                                1355  1.337691   27.83  0.077189
"""


def _read(printed: str) -> tuple[ThesisTable, ...]:
    tables: list[ThesisTable] = []
    for line in printed.split("\n")[1:-1]:
        *head, seconds, overdraw, frames, error = line.split()
        if head:
            number, model, brdf, clusters = head
            tables.append(ThesisTable(int(number), model, brdf, int(clusters), ()))
        last = tables[-1]
        method = _METHODS[len(last.rows)]
        row = ThesisRow(method, int(seconds), float(overdraw), float(frames), float(error))
        tables[-1] = replace(last, rows=(*last.rows, row))
    return tuple(tables)


TABLES = _read(_PRINTED)
# What a mesh's name must hold to stand for a model of the thesis; the diplodocus stands for its Dino.
_NAMES = {"dino": "Dino", "diplodocus": "Dino", "horse": "Horse", "bunny": "Bunny"}


def thesis_table(scene: str, brdf: str, clusters: int) -> ThesisTable | None:
    """The table that a row can be set beside, if there is one.

    Args:
        scene: a scene's name, such as "horse_20k".
        brdf: "phong:...", "cook-torrance:..."; parameters are ignored, for the thesis gives none.
    """
    model = next((model for part, model in _NAMES.items() if part in scene.lower()), None)
    kind = brdf.partition(":")[0]
    found = (table for table in TABLES if (table.model, table.brdf, table.clusters) == (model, kind, clusters))
    return next(found, None)
