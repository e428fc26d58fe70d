"""`dalembert.frozen.frozen` beside `dataclasses.dataclass(frozen=True)`: objects of both behave alike."""

import inspect
import pickle
from dataclasses import FrozenInstanceError, asdict, dataclass, field, fields, replace

import pytest

from dalembert.frozen import frozen


def _point(decorate):
    @decorate
    class Point:
        x: float
        y: float = 2.0
        tags: list = field(default_factory=list, compare=False)
        note: str = field(default="", repr=False, hash=False)
        key: int = field(default=7, kw_only=True)
        norm: float = field(init=False)

        def __post_init__(self):
            object.__setattr__(self, "norm", abs(self.x) + abs(self.y))

    return Point


def _solid(decorate):
    @decorate
    class Solid(_point(decorate)):
        z: float = 0.0

    return Solid


MAKERS = (_point, _solid)


@pytest.fixture(params=MAKERS, ids=lambda make: make.__name__)
def classes(request):
    """One class by `frozen` and one by `dataclasses`, of the same text."""
    return request.param(frozen), request.param(dataclass(frozen=True))


CALLS = (((1.0,), {}), ((1.0, 3.0), {"key": 4}), ((), {"x": -1.0, "tags": [1], "note": "a"}))


@pytest.mark.parametrize(("args", "options"), CALLS)
def test_objects_hold_the_same_values_and_texts(classes, args, options):
    ours, theirs = (cls(*args, **options) for cls in classes)
    assert asdict(ours) == asdict(theirs)
    assert repr(ours) == repr(theirs)
    assert [f.name for f in fields(ours)] == [f.name for f in fields(theirs)]
    assert asdict(replace(ours, y=9.0)) == asdict(replace(theirs, y=9.0))


def test_constructors_have_the_same_parameters(classes):
    ours, theirs = (inspect.signature(cls).parameters.values() for cls in classes)
    described = [[(p.name, p.kind, p.default is p.empty) for p in found] for found in (ours, theirs)]
    assert described[0] == described[1]


@pytest.mark.parametrize("other", [{}, {"tags": [1]}, {"note": "a"}, {"key": 1}, {"y": 3.0}])
def test_objects_are_equal_and_have_one_hash_where_those_of_dataclasses_do(classes, other):
    pairs = [(cls(1.0), cls(1.0, **other)) for cls in classes]
    assert len({a == b for a, b in pairs}) == 1
    assert len({hash(a) == hash(b) for a, b in pairs}) == 1
    assert pairs[0][0] != pairs[1][0]


def test_nothing_can_be_assigned_or_deleted(classes):
    for made in (cls(1.0) for cls in classes):
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
            made.x = 2.0
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'other'"):
            made.other = 2.0
        with pytest.raises(FrozenInstanceError, match="cannot delete field 'x'"):
            del made.x


def test_wrong_arguments_are_errors(classes):
    for cls in classes:
        for args, options in (((), {}), ((1.0, 2.0, [], "", 5, 6), {}), ((1.0,), {"none": 1})):
            with pytest.raises(TypeError, match=r"__init__\(\)"):
                cls(*args, **options)


@frozen
class _Kept:
    x: float
    others: tuple = ()


@frozen(eq=False)
class _Alone:
    x: float


@frozen(kw_only=True)
class _Named:
    x: float


@frozen
class _Own:
    x: float

    def __repr__(self):
        return "own"

    def __eq__(self, other):
        return True

    def __hash__(self):
        return 3


def test_objects_are_pickled():
    assert pickle.loads(pickle.dumps(_Kept(1.0, (2,)))) == _Kept(1.0, (2,))


def test_without_eq_an_object_equals_itself_alone():
    one = _Alone(1.0)
    assert one == one and one != _Alone(1.0) and len({one, _Alone(1.0)}) == 2


def test_fields_by_name_alone():
    assert _Named(x=1.0).x == 1.0
    with pytest.raises(TypeError, match="positional"):
        _Named(1.0)


def test_methods_of_the_class_itself_are_kept():
    assert repr(_Own(1.0)) == "own" and _Own(1.0) == _Own(2.0) and hash(_Own(1.0)) == 3


def test_a_class_without_fields_is_equal_to_itself():
    @frozen
    class Empty:
        pass

    assert Empty() == Empty() and hash(Empty()) == hash(Empty()) and "Empty()" in repr(Empty())
