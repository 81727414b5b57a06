"""Draws photographs, and the faults of bad ones."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from datagen.appearance.photograph.border import Border, draw_border, draw_letterbox
from datagen.appearance.photograph.lens import Lens
from datagen.appearance.photograph.photograph import Photograph
from datagen.appearance.photograph.photograph_config import FAULTS, PhotographConfig
from datagen.appearance.photograph.processing import INTERPOLATIONS, Processing
from datagen.appearance.photograph.sensor import Sensor, Tone


def draw_photograph(rng: np.random.Generator, config: PhotographConfig) -> Photograph:
    """Draws a photograph. Some have one or two faults, and some have a border within the picture."""
    photograph = Photograph(
        seed=int(rng.integers(2**31)),
        lens=_draw_lens(rng, config),
        sensor=_draw_sensor(rng, config),
        tone=_draw_tone(rng, config),
        processing=_draw_processing(rng, config),
        quality=int(rng.uniform(*config.jpeg_quality)),
    )
    faults: list[str] = []
    if rng.random() < config.bad_share:
        weights = np.array([getattr(config, f"bad_{name}") for name in FAULTS])
        most = min(2 if rng.random() < config.second_fault_share else 1, int((weights > 0).sum()))
        faults = [str(name) for name in rng.choice(FAULTS, most, replace=False, p=weights / weights.sum())]
    for name in faults:
        photograph = _FAULTS[name](photograph, rng, config)
    kind = rng.random()
    border = Border()
    if kind < config.border_share:
        border = draw_border(rng, config.largest_border)
    elif kind < config.border_share + config.letterbox_share:
        border = draw_letterbox(rng)
    is_colour_halved = bool(rng.random() < 0.8)
    return replace(photograph, border=border, is_colour_halved=is_colour_halved, faults="+".join(sorted(faults)))


def _draw_lens(rng: np.random.Generator, config: PhotographConfig) -> Lens:
    axis = rng.uniform(-0.5, 0.5, 2)
    return Lens(
        defocus=_round(min(rng.exponential(config.defocus), 3 * config.defocus)),
        magnification=_round(rng.normal(0, 0.003)) if rng.random() < config.chromatic_aberration_share else 0.0,
        vignetting=_round(rng.uniform(0.1, 0.6)) if rng.random() < config.vignetting_share else 0.0,
        axis=(_round(axis[0]), _round(axis[1])),
        bloom=_round(rng.uniform(0.05, 0.25)) if rng.random() < config.bloom_share else 0.0,
    )


def _draw_sensor(rng: np.random.Generator, config: PhotographConfig) -> Sensor:
    red, blue = np.exp(rng.normal((config.warmth, -config.warmth), config.white_balance_error))
    error = np.clip(rng.normal(0, config.exposure_error_ev), -1.2, 1.2)
    return Sensor(
        is_metered_on_face=bool(rng.random() < config.face_metering_share),
        metering_strength=_round(rng.uniform(*config.metering_strength)),
        exposure_error_ev=_round(error),
        white_balance=_round(rng.uniform(*config.white_balance)),
        gains=(_round(red), 1.0, _round(blue)),
        noise=_round(min(rng.exponential(config.noise), 3 * config.noise)),
        read_noise_share=_round(rng.uniform(0.1, 0.6)),
        colour_noise=_round(rng.uniform(0, 0.6)),
    )


def _draw_tone(rng: np.random.Generator, config: PhotographConfig) -> Tone:
    drawn = Tone(
        roll_off=_round(rng.uniform(0.4, 1.0)) if rng.random() < config.film_curve_share else 0.0,
        contrast=_round(config.median_contrast * np.exp(np.clip(rng.normal(0, config.contrast), -0.5, 0.5))),
        gamma=_round(np.exp(np.clip(rng.normal(0, config.gamma), -0.35, 0.4))),
        saturation=_round(np.exp(np.clip(rng.normal(0, config.saturation), -1.0, 0.7))),
    )
    if rng.random() >= config.monochrome_share:
        return drawn
    return replace(
        drawn, saturation=0.0, tint=_draw_tint(rng) if rng.random() < config.toned_share else (1.0, 1.0, 1.0)
    )


def _draw_tint(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draws the tint of a toned print: mostly sepia."""
    if rng.random() < 0.7:
        strength = rng.uniform(0.4, 1.0)
        red, green, blue = (_round(1 + strength * (gain - 1)) for gain in (1.0, 0.86, 0.66))  # sepia
    else:
        red, green, blue = (_round(gain) for gain in rng.uniform(0.75, 1.0, 3))
    return red, green, blue


def _draw_processing(rng: np.random.Generator, config: PhotographConfig) -> Processing:
    is_sharpened = rng.random() < config.sharpened_share
    drawn = Processing(
        smoothing=_round(rng.uniform(0.5, 1.0)) if rng.random() < config.smoothed_share else 0.0,
        sharpening=_round(rng.uniform(0.2, 0.9)) if is_sharpened else 0.0,
        sharpening_px=_round(rng.uniform(0.6, 1.6)) if is_sharpened else 1.0,
        first_quality=int(rng.uniform(45, 95)) if rng.random() < config.twice_jpeg_share else 0,
    )
    if rng.random() >= config.overlay_share:
        return drawn
    return replace(
        drawn,
        text=_draw_text(rng),
        text_place=(_round(rng.uniform(-0.1, 0.6)), _round(rng.uniform(0.08, 0.98))),
        text_size=_round(rng.uniform(0.02, 0.10)),
        text_opacity=_round(rng.uniform(0.25, 0.95)),
    )


def _draw_text(rng: np.random.Generator) -> str:
    """Draws a date or a random name, as on photographs."""
    if rng.random() < 0.4:
        day, month, year = rng.integers(1, 29), rng.integers(1, 13), rng.integers(1990, 2026)
        return str(
            rng.choice([f"{day:02d}.{month:02d}.{year}", f"{year}/{month}/{day}", f"{month} {day} {year % 100}"])
        )
    letters = rng.choice(list("aabcdeefghiijklmnoopqrsttuvwxyz"), int(rng.integers(4, 13)))
    word = "".join(str(letter) for letter in letters).capitalize()
    return str(rng.choice(["(c) ", "", "www."])) + word


def _badly_exposed(taken: Photograph, rng: np.random.Generator, config: PhotographConfig) -> Photograph:
    error = rng.uniform(0.7, config.largest_exposure_error_ev) * rng.choice([-1, 1])
    tones = taken.tone
    if rng.random() < 0.6:
        tones = replace(tones, black=_round(rng.uniform(0, 0.12)), white=_round(rng.uniform(0.75, 1.0)))
    if rng.random() < 0.5:
        tones = replace(tones, gamma=_round(rng.uniform(0.7, 1.5)), contrast=_round(np.exp(rng.normal(0.1, 0.35))))
    return replace(taken, sensor=replace(taken.sensor, exposure_error_ev=_round(error)), tone=tones)


def _badly_coloured(taken: Photograph, rng: np.random.Generator, _: PhotographConfig) -> Photograph:
    red, blue = np.exp(rng.normal(0, 0.25, 2))
    balanced = replace(taken.sensor, gains=(_round(red), 1.0, _round(blue)), white_balance=_round(rng.uniform(0, 0.6)))
    saturation = taken.tone.saturation * np.exp(np.clip(rng.normal(0, 0.5), -2, 0.8))
    return replace(taken, sensor=balanced, tone=replace(taken.tone, saturation=_round(saturation)))


def _out_of_focus(taken: Photograph, rng: np.random.Generator, config: PhotographConfig) -> Photograph:
    return replace(taken, lens=replace(taken.lens, defocus=_round(rng.uniform(*config.bad_defocus))))


def _moved(taken: Photograph, rng: np.random.Generator, config: PhotographConfig) -> Photograph:
    bend = _round(rng.normal(0, 0.4)) if rng.random() < 0.4 else 0.0
    length, direction = _round(rng.uniform(*config.bad_motion_length)), _round(rng.uniform(0, 180))
    return replace(taken, lens=replace(taken.lens, motion=length, motion_deg=direction, motion_bend=bend))


def _noisy(taken: Photograph, rng: np.random.Generator, config: PhotographConfig) -> Photograph:
    low, high = np.log(np.maximum(config.bad_noise_deviation, 1e-4))
    noise, colour = _round(np.exp(rng.uniform(low, high))), _round(rng.uniform(0.2, 1.0))
    smoothing = _round(rng.uniform(0.5, 1.0)) if rng.random() < 0.3 else taken.processing.smoothing
    noisy = replace(taken.sensor, noise=noise, colour_noise=colour)
    return replace(taken, sensor=noisy, processing=replace(taken.processing, smoothing=smoothing))


def _enlarged(taken: Photograph, rng: np.random.Generator, config: PhotographConfig) -> Photograph:
    low, high = np.log(config.resolution_px)
    way = str(rng.choice(list(INTERPOLATIONS), p=[0.12, 0.44, 0.44]))
    small = replace(taken.processing, side_px=round(float(np.exp(rng.uniform(low, high)))), enlarged_by=way)
    if rng.random() < 0.5:
        small = replace(small, first_quality=int(rng.uniform(40, 92)))
    return replace(taken, processing=small)


def _badly_filed(taken: Photograph, rng: np.random.Generator, config: PhotographConfig) -> Photograph:
    filed = replace(taken, quality=int(rng.uniform(*config.bad_jpeg_quality)))
    if rng.random() >= 0.3:
        return filed
    haloes = replace(
        taken.processing, sharpening=_round(rng.uniform(0.8, 2.2)), sharpening_px=_round(rng.uniform(0.8, 3))
    )
    return replace(filed, processing=haloes)


def _on_old_film(taken: Photograph, rng: np.random.Generator, _: PhotographConfig) -> Photograph:
    aged = replace(
        taken.processing,
        grain=_round(rng.uniform(2, 14)),
        scratches=int(rng.poisson(1.5)) if rng.random() < 0.6 else 0,
        dust=int(rng.poisson(12)) if rng.random() < 0.6 else 0,
    )
    faded = replace(
        taken.tone,
        roll_off=1.0,
        lift=_round(rng.uniform(0, 0.2)),
        contrast=_round(rng.uniform(0.7, 1.5)),
        saturation=0.0 if rng.random() < 0.6 else _round(rng.uniform(0.3, 0.8)),
        tint=_draw_tint(rng) if rng.random() < 0.6 else (1.0, 1.0, 1.0),
    )
    return replace(taken, processing=aged, tone=faded)


def _on_a_screen(taken: Photograph, rng: np.random.Generator, _: PhotographConfig) -> Photograph:
    return replace(taken, processing=replace(taken.processing, moire=_round(rng.uniform(0.03, 0.18))))


def _interlaced(taken: Photograph, rng: np.random.Generator, _: PhotographConfig) -> Photograph:
    shift = int(rng.integers(1, 6)) * int(rng.choice([-1, 1]))
    return replace(taken, processing=replace(taken.processing, interlace=_round(shift / 256)))


def _posterised(taken: Photograph, rng: np.random.Generator, _: PhotographConfig) -> Photograph:
    return replace(taken, processing=replace(taken.processing, colours=int(rng.integers(4, 16))))


def _into_the_light(taken: Photograph, rng: np.random.Generator, _: PhotographConfig) -> Photograph:
    lens = replace(taken.lens, glare=_round(rng.uniform(0.15, 0.6)), bloom=_round(rng.uniform(0.1, 0.5)))
    return replace(taken, lens=lens)


_FAULTS: Mapping[str, Callable[[Photograph, np.random.Generator, PhotographConfig], Photograph]] = {
    "exposure": _badly_exposed,
    "colour": _badly_coloured,
    "focus": _out_of_focus,
    "motion": _moved,
    "noise": _noisy,
    "resolution": _enlarged,
    "file": _badly_filed,
    "film": _on_old_film,
    "screen": _on_a_screen,
    "interlace": _interlaced,
    "posterised": _posterised,
    "glare": _into_the_light,
}


def _round(value: float) -> float:
    """Rounds to four significant digits, which keep JSON short and make no visible difference."""
    return float(f"{float(value):.4g}")
