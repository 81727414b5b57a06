"""Emotions, sounds of speech and grimaces as mixtures of the named expressions.

A recipe is the strength of every shape at full intensity. A name without a side stands for both sides of a pair. Each
shape in `MAYBE` is added with a probability of one half.

Source: the facial action units of the basic emotions in Ekman and Friesen 1978, translated to the shapes of ARKit by
their meaning. Strengths were chosen by eye.
"""

from collections.abc import Mapping

Recipe = Mapping[str, float]

EMOTIONS: Mapping[str, Recipe] = {
    "smile": {"mouthSmile": 0.8, "cheekSquint": 0.4, "eyeSquint": 0.3, "mouthDimple": 0.25},
    "joy": {
        "mouthSmile": 1.0,
        "mouthUpperUp": 0.7,
        "mouthLowerDown": 0.5,
        "cheekSquint": 0.8,
        "eyeSquint": 0.5,
        "jawOpen": 0.2,
    },
    "laughter": {"mouthSmile": 1.0, "mouthUpperUp": 0.8, "cheekSquint": 1.0, "eyeSquint": 0.7, "jawOpen": 0.5},
    "anger": {"browDown": 1.0, "eyeSquint": 0.4, "noseSneer": 0.5, "mouthPress": 0.6, "mouthFrown": 0.4},
    "disgust": {"noseSneer": 1.0, "mouthUpperUp": 0.6, "browDown": 0.6, "cheekSquint": 0.5, "mouthFrown": 0.35},
    "fear": {"browInnerUp": 0.9, "browOuterUp": 0.5, "eyeWide": 0.8, "mouthStretch": 0.6, "jawOpen": 0.25},
    "sadness": {"browInnerUp": 1.0, "browDown": 0.25, "mouthFrown": 0.8, "mouthShrugLower": 0.6, "eyeSquint": 0.2},
    "surprise": {"browInnerUp": 0.9, "browOuterUp": 1.0, "eyeWide": 0.8, "jawOpen": 0.55},
    "contempt": {"mouthSmileLeft": 0.5, "mouthDimpleLeft": 0.7, "eyeSquintLeft": 0.3, "mouthPress": 0.25},
    "pain": {"browDown": 0.8, "cheekSquint": 0.9, "eyeSquint": 0.8, "noseSneer": 0.5, "mouthStretch": 0.45},
}

SMILES = ("smile", "joy", "laughter")

# Shapes that are added with a probability of one half.
MAYBE: Mapping[str, Recipe] = {
    "smile": {"browOuterUp": 0.2, "mouthUpperUp": 0.6, "mouthLowerDown": 0.35, "jawOpen": 0.12, "mouthStretch": 0.2},
    "joy": {"mouthLowerDown": 0.2, "browInnerUp": 0.3, "mouthStretch": 0.25, "noseSneer": 0.15},
    "laughter": {"mouthLowerDown": 0.45, "browDown": 0.3, "noseSneer": 0.3, "mouthStretch": 0.3},
    "anger": {"jawForward": 0.4, "mouthRollLower": 0.4, "mouthShrugLower": 0.5, "eyeWide": 0.3},
    "disgust": {"mouthShrugUpper": 0.3, "mouthLowerDown": 0.3, "eyeSquint": 0.5, "jawOpen": 0.2},
    "fear": {"mouthLowerDown": 0.4, "browDown": 0.25, "jawOpen": 0.2},
    "sadness": {"mouthPress": 0.3, "mouthRollLower": 0.3, "eyeBlink": 0.25, "mouthPucker": 0.2},
    "surprise": {"mouthFunnel": 0.3, "jawOpen": 0.25, "mouthStretch": 0.2},
    "contempt": {"browDown": 0.3, "mouthUpperUpLeft": 0.3, "browOuterUpRight": 0.4},
    "pain": {"jawOpen": 0.3, "mouthUpperUp": 0.5, "eyeBlink": 0.5, "mouthLowerDown": 0.3},
}

# Sounds by the shape of the mouth. Speech is a mixture of two, the last sound and the next.
SPEECH: Mapping[str, Recipe] = {
    "a": {"jawOpen": 0.5, "mouthLowerDown": 0.3, "mouthUpperUp": 0.1},
    "e": {"jawOpen": 0.25, "mouthStretch": 0.4, "mouthLowerDown": 0.3, "mouthSmile": 0.15},
    "i": {"jawOpen": 0.12, "mouthSmile": 0.35, "mouthStretch": 0.3, "mouthUpperUp": 0.2, "mouthLowerDown": 0.25},
    "o": {"jawOpen": 0.35, "mouthFunnel": 0.55, "mouthPucker": 0.2},
    "u": {"jawOpen": 0.15, "mouthPucker": 0.75, "mouthFunnel": 0.35},
    "f": {"jawOpen": 0.1, "mouthRollLower": 0.45, "mouthUpperUp": 0.25},
    "m": {"jawOpen": 0.12, "mouthClose": 0.12, "mouthPress": 0.35, "mouthRollUpper": 0.15, "mouthRollLower": 0.2},
    "l": {"jawOpen": 0.3, "mouthLowerDown": 0.2, "tongueOut": 0.12, "mouthUpperUp": 0.15},
    "sh": {"jawOpen": 0.1, "mouthFunnel": 0.5, "mouthPucker": 0.3, "mouthLowerDown": 0.25},
    "s": {"jawOpen": 0.08, "mouthStretch": 0.3, "mouthUpperUp": 0.2, "mouthLowerDown": 0.35},
    "t": {"jawOpen": 0.18, "mouthLowerDown": 0.25, "mouthShrugUpper": 0.15},
    "r": {"jawOpen": 0.2, "mouthFunnel": 0.3, "mouthPucker": 0.35, "mouthShrugUpper": 0.2},
}

EXTREMES: Mapping[str, Recipe] = {
    "yawn": {"jawOpen": 1.0, "eyeBlink": 0.6, "cheekSquint": 0.5, "browInnerUp": 0.5, "mouthFunnel": 0.25},
    "shout": {"jawOpen": 0.85, "mouthLowerDown": 0.6, "mouthUpperUp": 0.5, "browDown": 0.7, "noseSneer": 0.5},
    "scream": {"jawOpen": 0.95, "mouthStretch": 0.6, "eyeSquint": 0.8, "cheekSquint": 0.7, "browInnerUp": 0.5},
    "awe": {"jawOpen": 0.9, "browInnerUp": 1.0, "browOuterUp": 1.0, "eyeWide": 1.0},
    "bared teeth": {"mouthStretch": 0.7, "mouthUpperUp": 0.8, "mouthLowerDown": 0.9, "noseSneer": 0.4},
    "puffed cheeks": {"cheekPuff": 1.0, "mouthPucker": 0.35, "mouthPress": 0.3, "eyeWide": 0.3},
    "kiss": {"mouthPucker": 1.0, "mouthFunnel": 0.2, "browInnerUp": 0.2, "jawOpen": 0.05},
    "tongue": {"tongueOut": 1.0, "jawOpen": 0.6, "mouthLowerDown": 0.3},
    "lips rolled in": {"mouthRollLower": 0.9, "mouthRollUpper": 0.9, "mouthPress": 0.4, "mouthDimple": 0.2},
    "skewed mouth": {"mouthLeft": 0.9, "jawLeft": 0.4, "mouthPress": 0.3, "eyeSquintLeft": 0.4},
    "skewed jaw": {"jawLeft": 1.0, "jawOpen": 0.2, "mouthLeft": 0.2},
    "chin up": {"mouthShrugLower": 1.0, "mouthShrugUpper": 0.7, "mouthFrown": 0.7, "browDown": 0.3},
    "underbite": {"jawForward": 1.0, "mouthShrugLower": 0.4, "browDown": 0.4},
    "one brow": {"browOuterUpLeft": 1.0, "browInnerUp": 0.2, "browDownRight": 0.8, "eyeSquintRight": 0.3},
    "screwed up": {"eyeBlink": 1.0, "cheekSquint": 1.0, "noseSneer": 1.0, "browDown": 1.0, "mouthUpperUp": 0.5},
}
