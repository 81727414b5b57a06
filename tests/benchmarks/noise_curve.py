"""Error of landmarks against noise on both maps, with 5 % gross outliers, for lambda estimated and for two constants.

python -m tests.benchmarks.noise_curve [--faces 20] [--out out/noise_curve.json] [--picture docs/images/fit_noise.png]
"""

from pathlib import Path

from matplotlib.figure import Figure

from pix2face.fitting.face_fit import FaceFit, fit_face
from pix2face.fitting.fit_options import EXACT_MAPS_REGULARISATION, PREDICTED_MAPS_REGULARISATION, Regularisation
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import builtin_model
from tests.benchmarks.closed_loop import measure, summary
from tests.benchmarks.measuring import options_parser, write_report
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import KnownFace

NOISE_MM = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
OUTLIERS = 0.05
LAMBDAS: dict[str, Regularisation] = {
    "estimated": "estimate",
    f"{EXACT_MAPS_REGULARISATION:g} mm2": EXACT_MAPS_REGULARISATION,
    f"{PREDICTED_MAPS_REGULARISATION:g} mm2": PREDICTED_MAPS_REGULARISATION,
}
PARTS = {"visible": "visible_landmarks_percent", "occluded": "occluded_landmarks_percent"}


def curves(n_faces: int) -> dict[str, dict[str, list[float]]]:
    """Mean errors (% of the eye distance) at each noise, for each lambda and part."""
    model = builtin_model()
    out: dict[str, dict[str, list[float]]] = {name: {part: [] for part in PARTS} for name in LAMBDAS}
    for name, regularisation in LAMBDAS.items():

        def fit(_: KnownFace, maps: FaceMaps, regularisation: Regularisation = regularisation) -> FaceFit:
            return fit_face(maps, model, paper_fit(regularisation=regularisation))

        for noise in NOISE_MM:
            errors = summary(measure(model, n_faces, fit, noise, OUTLIERS))
            for part, key in PARTS.items():
                out[name][part].append(round(errors[key]["mean"], 4))
    return out


def draw(found: dict[str, dict[str, list[float]]], path: Path) -> None:
    """Both parts side by side."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    for axes, part in zip(figure.subplots(1, 2, sharey=True), PARTS, strict=True):
        for name, errors in found.items():
            axes.plot(NOISE_MM, errors[part], marker="o", label=f"λ {name}".replace("mm2", "mm²"))
        axes.set(title=f"{part} landmarks", xlabel="noise of each coordinate of both maps (mm)")
        axes.set_xscale("symlog", linthresh=0.1)
        axes.set_xticks(NOISE_MM, [f"{noise:g}" for noise in NOISE_MM])
        axes.set_yscale("log")
        axes.axhline(0.5, color="grey", linewidth=0.8, linestyle=":")
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("mean error (% of the eye distance)")
    figure.axes[0].legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100, metadata={"Software": None})


def main() -> None:
    """Measures, writes and draws."""
    parser = options_parser(__doc__, Path("out/noise_curve.json"))
    parser.add_argument("--faces", type=int, default=20)
    parser.add_argument("--picture", type=Path, default=Path("docs/images/fit_noise.png"))
    options = parser.parse_args()
    found = curves(options.faces)
    draw(found, options.picture)
    report = {"faces": options.faces, "outliers": OUTLIERS, "noise_mm": NOISE_MM, "mean_error_percent": found}
    write_report(report, options.out)


if __name__ == "__main__":
    main()
