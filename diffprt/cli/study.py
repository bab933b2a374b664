"""Studies: diffprt set beside others, with figures."""

from __future__ import annotations

import sys
from pathlib import Path

import typer

from diffprt.brdf import parse_brdf
from diffprt.cli import study_optimize
from diffprt.cli.inputs import parse_color
from diffprt.cli.report import JsonFile, check_output, print_table, write_report
from diffprt.cli.study_inverse import print_gradient, print_inverse
from diffprt.cli.study_tables import print_clustering, print_overdraw, print_tolerance, print_visibility
from diffprt.scene import BUILTIN_SCENES

app = typer.Typer(help=__doc__, no_args_is_help=True, rich_markup_mode=None)


@app.command(help="Render against a Mitsuba path trace of the same scene under the same light.")
def reference(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    light: list[str] = typer.Option(["sky", "studio"], help="sky, studio or a map; may be repeated."),
    output: Path = typer.Option(Path("out/reference"), "-o", "--output", help="The folder for pictures."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(4096, help="Rays per receiver."),
    bounces: int = typer.Option(6, help="Interreflections."),
    size: int = typer.Option(256, help="Pixels a side."),
    samples: int = typer.Option(1024, help="Mitsuba's samples per pixel, in each of two halves."),
    albedo: str = typer.Option(None, help="Replaces every albedo: 0.8 or r,g,b."),
    brdf: list[str] = typer.Option([], help="Makes surfaces glossy, as in 'diffprt bake'; may be repeated."),
    order_out: int = typer.Option(None, help="With --brdf: SH bands of exit radiance; --order by default."),
    up: str = typer.Option(None, help="The axis of the file that points up; y by default."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.reference import reference_study

    color = None if albedo is None else parse_color(albedo, "albedo")
    check_output(output, directory=True)
    report = reference_study(
        source,
        light,
        output,
        order=order,
        rays=rays,
        bounces=bounces,
        size=size,
        samples=samples,
        albedo=color,
        brdf=[parse_brdf(text) for text in brdf],
        order_out=order_out,
        up=up,
    )
    for note in report["notes"]:
        print(f"note: {note}")
    shares = ("relative_rmse", "resolution", "noise", "difference")
    rows = [
        [r["light"], *(f"{100 * r[key]:.2f} %" for key in shares), f"{r['mean_ratio']:.4f}"] for r in report["rows"]
    ]
    columns = ["light", "error", "resolved to", "noise", "difference", "mean ratio"]
    print_table(f"{source} against Mitsuba (error: difference less noise)", columns, rows)
    print(f"pictures: {output}")
    write_report(json_file, "study reference", report)


@app.command(help="Rays per second, structure and exactness of visibility, beside Embree and Mitsuba.")
def visibility(
    source: list[str] = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: builtin:bunny builtin:closed_box]"
    ),
    output: Path = typer.Option(Path("out/visibility"), "-o", "--output", help="The folder for the chart."),
    rays: list[int] = typer.Option([256, 2048], help="Rays per receiver; may be repeated."),
    runs: int = typer.Option(5, help="Rounds in which all take turns."),
    seconds: float = typer.Option(1.0, help="Least length of one timing."),
    large: int = typer.Option(1_500_000, help="Triangles of the mesh whose structure is built; 0 for none."),
    test_rays: int = typer.Option(1_000_000, help="Rays of the escape test and against brute force."),
    brute_tests: float = typer.Option(1e10, help="Most triangle tests of brute force per scene."),
    seed: int = typer.Option(0, help="Draws receivers and directions."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.visibility import visibility_study

    check_output(output, directory=True)
    report = visibility_study(
        source or ["builtin:bunny", "builtin:closed_box"],
        output,
        rays=rays,
        runs=runs,
        seconds=seconds,
        large=large,
        test_rays=test_rays,
        brute_tests=brute_tests,
        seed=seed,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study visibility", report)
    print_visibility(report)


@app.command(help="Whether --tolerance delivers, and at which cost against the best fixed number of rays.")
def tolerance(
    source: list[str] = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: every built-in scene]"
    ),
    data: Path = typer.Option(None, help="A folder whose meshes are added."),
    random: int = typer.Option(12, help="Random scenes that are added."),
    tolerance: list[float] = typer.Option([0.03, 0.01], help="Relative errors asked for; may be repeated."),
    bounces: list[int] = typer.Option([0, 2], help="Diffuse interreflections; may be repeated."),
    order: int = typer.Option(6, help="SH bands."),
    seed: int = typer.Option(0, help="Of bakes, and of the first random scene."),
    truth_rays: int = typer.Option(20_000_000, help="Most rays of a truth; fewer receivers are compared beyond it."),
    output: Path = typer.Option(Path("out/tolerance"), "-o", "--output", help="The folder for rows and chart."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.tolerance import tolerance_study

    check_output(output, directory=True)
    report = tolerance_study(
        source or [f"builtin:{name}" for name in BUILTIN_SCENES],
        output,
        data=data,
        random=random,
        tolerances=tolerance,
        bounces=bounces,
        order=order,
        seed=seed,
        truth_rays=truth_rays,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study tolerance", report)
    print_tolerance(report)


@app.command(
    help="The 2005 thesis's tables 5.1 to 5.17 for any mesh: squared error and overdraw, its methods and ours."
)
def overdraw(
    source: list[str] = typer.Argument(
        None, metavar="[SCENE]...", help="Scene files or builtin:NAME.  [default: builtin:bunny]"
    ),
    brdf: list[str] = typer.Option(
        ["phong:exponent=16", "cook-torrance:roughness=0.3"],
        help="NAME:parameter=value,...; diffuse for diffuse transfer; shadow for matrices without BRDF; repeatable.",
    ),
    clusters: list[int] = typer.Option([256, 64, 128, 192], help="Clusters; may be repeated."),
    method: list[str] = typer.Option(
        None,
        help="NAME[=COHERENCE][~SLACK][@REGISTERS], NAME as in compress, faiss or position-only; repeatable.  "
        "[default: all that count]",
    ),
    components: int = typer.Option(8, help="Components per cluster."),
    registers: list[int] = typer.Option([256, 1024, 4096], help="float4 registers of a pass; may be repeated."),
    light: list[str] = typer.Option(["sky", "studio"], help="Of the image error: sky, studio or a map; repeatable."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    bounces: int = typer.Option(0, help="Interreflections."),
    channels: int = typer.Option(None, help="1 or 3.  [default: as many as the BRDF has]"),
    seed: int = typer.Option(0, help="Of rays and starts."),
    seeds: int = typer.Option(3, help="Starts of original CPCA."),
    minutes: float = typer.Option(None, help="Begin no row after these; repeat the command to go on."),
    output: Path = typer.Option(Path("out/overdraw"), "-o", "--output", help="The folder; its rows are kept."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.overdraw import overdraw_study
    from diffprt.study.overdraw_methods import DEFAULT

    check_output(output, directory=True)
    report = overdraw_study(
        source or ["builtin:bunny"],
        output,
        brdfs=brdf,
        clusters=clusters,
        methods=method or DEFAULT,
        components=components,
        budgets=registers,
        lights=light,
        order=order,
        rays=rays,
        bounces=bounces,
        channels=channels,
        seed=seed,
        seeds=seeds,
        minutes=minutes,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study overdraw", report)
    print_overdraw(report)


@app.command(help="A gradient step through a picture, timed beside Mitsuba's prb, and its direction compared.")
def gradient(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    order: int = typer.Option(6, help="SH bands of transfer and light."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    bounces: int = typer.Option(2, help="Interreflections, of Mitsuba's paths too."),
    size: int = typer.Option(256, help="Pixels a side."),
    samples: int = typer.Option(16, help="Mitsuba's samples per pixel of a timed step."),
    rows: int = typer.Option(32, help="Rows of the environment map whose texels are optimized."),
    rounds: int = typer.Option(7, help="In which all take turns."),
    truth_samples: int = typer.Option(1024, help="Mitsuba's samples per pixel of the gradients compared."),
    halves: int = typer.Option(2, help="Independent gradients of so many samples."),
    seed: int = typer.Option(0, help="Of the bake and of Mitsuba."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.gradient import gradient_study

    report = gradient_study(
        source,
        order=order,
        rays=rays,
        bounces=bounces,
        size=size,
        samples=samples,
        rows=rows,
        rounds=rounds,
        truth_samples=truth_samples,
        halves=halves,
        seed=seed,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study gradient", report)
    print_gradient(report)


@app.command(help="What clustering costs: ours beside k-means of faiss, and the whole best method.")
def clustering(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    signal: str = typer.Option("shadow", help="shadow, diffuse or a BRDF, NAME:parameter=value,..."),
    clusters: int = typer.Option(256, help="Clusters."),
    components: int = typer.Option(8, help="Components per cluster."),
    registers: int = typer.Option(256, help="float4 registers of a pass."),
    iterations: int = typer.Option(20, help="Of k-means."),
    rounds: int = typer.Option(3, help="In which ours and faiss take turns."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(1024, help="Rays per receiver."),
    channels: int = typer.Option(None, help="1 or 3.  [default: as many as the BRDF has]"),
    seed: int = typer.Option(0, help="Of rays, and of the first round."),
    output: Path = typer.Option(Path("out/clustering"), "-o", "--output", help="The folder that keeps the signal."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.clustering import clustering_study

    check_output(output, directory=True)
    report = clustering_study(
        source,
        output,
        signal=signal,
        clusters=clusters,
        components=components,
        registers=registers,
        iterations=iterations,
        rounds=rounds,
        order=order,
        rays=rays,
        channels=channels,
        seed=seed,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study clustering", report)
    print_clustering(report)


@app.command(help="Light and albedo recovered from Mitsuba's pictures and from another bake's, with noise.")
def inverse(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME, of one mesh."),
    order: int = typer.Option(4, help="SH bands of light and transfer."),
    rays: int = typer.Option(4096, help="Rays per receiver."),
    views: int = typer.Option(3, help="Pictures that a light is found from."),
    albedo_views: int = typer.Option(8, help="Pictures that an albedo is found from, under each light."),
    size: int = typer.Option(192, help="Pixels a side."),
    samples: int = typer.Option(512, help="Mitsuba's samples per pixel."),
    noise: float = typer.Option(0.01, help="Added to every pixel, a share of the picture's root mean square."),
    seed: int = typer.Option(0, help="Of rays and noise."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.study.inverse import inverse_study

    report = inverse_study(
        source,
        order=order,
        rays=rays,
        views=views,
        albedo_views=albedo_views,
        size=size,
        samples=samples,
        noise=noise,
        seed=seed,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study inverse", report)
    print_inverse(report)


@app.command(help="What a frame costs in a browser: clusters in one pass and in several, and uncompressed transfer.")
def display(
    source: str = typer.Argument("builtin:bunny", metavar="SCENE", help="A scene file or builtin:NAME."),
    clusters: int = typer.Option(64, help="Clusters."),
    components: int = typer.Option(8, help="Components per cluster."),
    registers: int = typer.Option(256, help="float4 uniforms of a pass."),
    order: int = typer.Option(6, help="SH bands."),
    rays: int = typer.Option(256, help="Rays per receiver."),
    size: int = typer.Option(512, help="Pixels a side."),
    frames: int = typer.Option(12, help="Frames that are timed in a round."),
    rounds: int = typer.Option(5, help="In which all take turns."),
    pictures: Path = typer.Option(None, help="Only takes pictures of the page, into this folder."),
    json_file: Path = JsonFile,
) -> None:
    from diffprt.cli.study_display import print_display
    from diffprt.study.display import display_study
    from diffprt.study.display_pictures import display_pictures

    if pictures is not None:
        check_output(pictures, directory=True)
        sizes = {"clusters": clusters, "components": components, "registers": registers, "order": order, "rays": rays}
        made = display_pictures(source, pictures, **sizes, say=lambda text: print(text, file=sys.stderr, flush=True))
        write_report(json_file, "study display", {"settings": sizes, "outputs": [str(path) for path in made]})
        print(f"{pictures}: {len(made)} pictures")
        return
    report = display_study(
        source,
        clusters=clusters,
        components=components,
        registers=registers,
        order=order,
        rays=rays,
        size=size,
        frames=frames,
        rounds=rounds,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )
    write_report(json_file, "study display", report)
    print_display(report)


app.command(help="What optimization brings over LBG + PCA and over our closed forms, on pictures never seen.")(
    study_optimize.optimize
)
app.command(help="Reference pictures path-traced by Mitsuba, for 'diffprt optimize --references'.")(
    study_optimize.references
)
app.command(help="A bake of direct light alone, trained towards path-traced pictures.")(study_optimize.unseen)
