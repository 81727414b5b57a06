"""How signatures are checked under pytest: an int may stand for a float, as everywhere in Python's type system."""

from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
