"""How skins come out: tone over the scale of melanin, colours of random people, cost of the shader. Prints JSON.

python -m tests.benchmarks.skin [--people 60]
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from datagen.appearance.person import draw_person
from datagen.appearance.skin.skin import draw_skin
from datagen.appearance.skin.skin_config import SkinConfig
from datagen.appearance.skin.tone import albedo_of_skin, density_of_melanin, lab_of_linear
from datagen.opengl.gl_context import create_gl_context
from pix2face.models.morphable_model import builtin_model
from tests.benchmarks.measuring import options_parser, processor_ms, write_report
from tests.datagen.appearance.skin.painted_skin import ALBEDO, PaintedSkin, painted_skin

RUNS = 20
GREY = "Surface skin(Surface s, vec2 uv, vec3 place, vec4 p0, vec4 p1, float pixel_mm) { s.albedo = place; return s; }"


def main() -> None:
    parser = options_parser(__doc__)
    parser.add_argument("--people", type=int, default=60)
    options = parser.parse_args()
    write_report({"melanin": _sweep(), **_drawn(options.people)}, options.out)


def individual_typology_angle_deg(colour: Float[ndarray, "*n 3"]) -> Float64[ndarray, " *n"]:
    """ITA: above 55 is very light, 28 to 41 intermediate, below -30 dark; people lie between about -60 and 65.

    Source: Chardon et al. 1991.
    """
    lab = lab_of_linear(colour)
    return np.asarray(np.rad2deg(np.arctan2(lab[..., 0] - 50, lab[..., 2])))


def _sweep() -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for melanin in np.linspace(0, 1, 11):
        colour = albedo_of_skin(density_of_melanin(float(melanin)), 0.16)
        rows.append(
            {
                "melanin": round(float(melanin), 2),
                "albedo": colour.round(3).tolist(),
                "lab": lab_of_linear(colour).round(1).tolist(),
                "ita_deg": round(float(individual_typology_angle_deg(colour)), 1),
            }
        )
    return rows


def _drawn(n: int) -> dict[str, object]:
    model, gl = builtin_model(), create_gl_context()
    rng = np.random.default_rng(0)
    with painted_skin(model, gl, ALBEDO) as paint:
        cheeks = np.array([_cheek(paint, rng) for _ in range(n)])
        skin = draw_skin(rng, SkinConfig(), draw_person(rng))
        painted = _milliseconds(lambda: paint.draw(skin))
        covered = int((paint.draw(skin)[1] > 0).sum())
    with painted_skin(model, gl, ALBEDO, {"skin": GREY}) as paint:
        grey = _milliseconds(lambda: paint.draw(skin))
    lab = lab_of_linear(cheeks)
    angle = individual_typology_angle_deg(cheeks)
    return {
        "people": {
            "n": n,
            "lab_percentiles_1_50_99": np.percentile(lab, [1, 50, 99], axis=0).round(1).tolist(),
            "ita_deg_percentiles_5_25_50_75_95": np.percentile(angle, [5, 25, 50, 75, 95]).round(0).tolist(),
        },
        "shader_ms": {"painted": painted, "one_colour": grey, "pixels": covered},
    }


def _cheek(paint: PaintedSkin, rng: np.random.Generator) -> np.ndarray:
    skin = draw_skin(rng, SkinConfig(make_up_share=0.0, face_paint_share=0.0), draw_person(rng))
    return paint.draw(skin)[0][158:172, 72:86].reshape(-1, 3).mean(axis=0)


def _milliseconds(work: Callable[[], object]) -> float:
    """CPU time of one run, the median of some."""
    (times,) = processor_ms({"work": work}, RUNS).values()
    return round(float(np.median(times)), 2)


if __name__ == "__main__":
    main()
