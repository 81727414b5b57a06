"""What HTML files that need no other file are made of: pictures as text, and hashes for their security policy."""

import base64
import hashlib


def base64_text(content: bytes) -> str:
    """Bytes as ASCII."""
    return base64.b64encode(content).decode("ascii")


def data_url(kind: str, content: bytes) -> str:
    """A picture (PNG or JPEG) as an address that holds it."""
    return f"data:image/{kind};base64,{base64_text(content)}"


def script_data(text: str) -> str:
    """JSON for a script element: none of its characters can end the element or start another."""
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def policy_hash(text: str) -> str:
    """How a content security policy names a script or a style that it allows."""
    return f"sha256-{base64_text(hashlib.sha256(text.encode()).digest())}"
