"""Memory of a kernel, declared once: named numbers, sizes and arrays.

    class Walk(Memory):
        t: float  # a number
        size: int  # a size: an argument of `made`; read-only for kernels
        stages: int = 4  # a size with a default
        y: Floats = array("size")
        half: Block = block("size", lambda s: s.size // 2)  # a range of components
        slopes: Floats = array(lambda s: s.stages * s.size)
        first: Floats = part("slopes", "size")  # the first elements of `slopes`
        second: Floats = after("first", "size")
        low: Floats = array("size", inf)  # with its initial value

A memory is one flat array of doubles, which can be copied, stored and passed to native
code: first the words of all names, in the order of the declarations (of a base
class first; a subclass may change initial values), then the arrays. The word of a
number or a size is its value; an array has two words, its first index and its length,
and a block two, its first index and its end.

A kernel whose parameter `s` is annotated with such a class writes `s.t`, `s.y[i]`,
`s.y[s.half]`; the translator turns each into loads and stores. Under CPython an
instance is a view of the flat array, and its arrays are numpy views of their exact
length.
"""

from __future__ import annotations

import inspect
from ctypes import addressof, c_char
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Self

    from lagsim.language.arrays import Floats

# The name of a size, or a function of a memory's sizes.
Length: TypeAlias = "str | Callable[[Any], int]"
# A range of components of vectors, under CPython.
Block: TypeAlias = "slice[int, int, None]"

NUMBER: Final = "float"
SIZE: Final = "int"
ARRAY: Final = "Floats"
BLOCK: Final = "Block"


class Field:
    """Declaration of a name in a memory; a descriptor for its array, slice or size.

    Array, slice and size never change: a memory stores the object in its `__dict__`,
    where Python finds it from the second access on without a call of this descriptor.

    Attributes
    ----------
    kind : str
        NUMBER, SIZE, ARRAY or BLOCK.
    name : str
    word : int
        Index of its first word in the flat array. The second word of an array is its
        length, of a block its end.
    value : float or sequence of float
        Initial value.
    length : str or function
        Length of an array, or end of a block.
    within : function or None
        Computes the first index of a block, or of an array within another one.
    replaces : bool
        Whether the array replaces that of a base class, whose length is another one.
    """

    def __init__(
        self,
        kind: str,
        value: float | Sequence[float] = 0.0,
        length: Length = "",
        within: Callable[[Memory], int] | None = None,
        *,
        replaces: bool = False,
    ) -> None:
        self.kind = kind
        self.name = ""
        self.word = 0
        self.value = value
        self.length = length
        self.within = within  # its first index: in the flat array, or of a block
        self.replaces = replaces

    def __get__(self, memory: Memory | None, _owner: type) -> Any:
        if memory is None:
            return self
        view: Any = int(memory.numbers[self.word])
        if self.kind != SIZE:
            begin, end = view, int(memory.numbers[self.word + 1])
            view = slice(begin, end)
            if self.kind == ARRAY:
                view = memory.flat[begin : begin + end]
        memory.__dict__[self.name] = view
        return view


class Number(Field):
    """Declaration of a number in a memory; a descriptor for its present value."""

    def __get__(self, memory: Memory | None, _owner: type) -> Any:
        return self if memory is None else memory.numbers[self.word]


class Option(Number):
    """A number that a user may choose: default, least and largest value, description.

    Parameters
    ----------
    value : float
        The default.
    least, most : float
        The range.
    about : str
        One sentence for the user.
    """

    def __init__(self, value: float, least: float, most: float, about: str) -> None:
        super().__init__(NUMBER, value)
        self.default, self.least, self.most, self.about = value, least, most, about


def address(flat: Floats) -> int:
    """Return the address of an array, three times as fast as `flat.ctypes.data`."""
    return addressof(c_char.from_buffer(flat.data))


def array(
    length: Length, value: float | Sequence[float] = 0.0, *, replaces: bool = False
) -> Any:
    """Declare an array by its length and its initial value.

    length : the name of a size, or a function of the memory that returns the length.
    replaces : see `Field`.
    """
    return Field(ARRAY, value, length, replaces=replaces)


def part(whole: str, length: Length, first: Length = "") -> Any:
    """Declare an array within the array `whole`, from its element `first` (or 0) on.

    length : see `array`.
    """
    return Field(
        ARRAY, 0.0, length, lambda memory: memory.place(whole) + memory.size_of(first)
    )


def after(other: str, length: Length) -> Any:
    """Declare an array that begins at the end of the array `other`.

    Both arrays lie within one array that is declared by `array`.

    length : see `array`.
    """
    return Field(ARRAY, 0.0, length, lambda memory: memory.place_after(other))


def block(end: Length, first: Length = "") -> Any:
    """Declare a range of components of vectors: `first` (or 0) to `end`, exclusive.

    Arrays whose length depends on the block are declared after it.
    """
    return Field(BLOCK, 0.0, end, lambda memory: memory.size_of(first))


def option(value: float, least: float, most: float, about: str) -> Any:
    """Declare a number that a user may choose, see `Option`."""
    return Option(value, least, most, about)


# Memories of up to this many words are copied from the first one of equal sizes, since
# a sweep creates many.
SMALL = 4096
_MADE: dict[object, Floats] = {}


class Memory:
    """A view of a flat array by the names that its class declares.

    Attributes
    ----------
    flat : ndarray of float, shape (length,)
        The whole memory.
    fields : dict
        The declarations, in the order of their words.
    number_words : dict
        The word of each number, by its name.
    numbers : memoryview
        View of `flat` for single numbers, several times faster than numpy.
    address : int
        Address of `flat`, for native code.

    Examples
    --------
    >>> class Walk(Memory):
    ...     t: float
    ...     size: int
    ...     y: Floats = array("size", 2.5)
    >>> walk = Walk.allocate(size=3)
    >>> walk.t = 1.0
    >>> walk.flat.tolist()  # t; size; first index and length of y; y
    [1.0, 3.0, 4.0, 3.0, 2.5, 2.5, 2.5]
    >>> walk.y.tolist()
    [2.5, 2.5, 2.5]
    """

    fields: ClassVar[dict[str, Field]] = {}
    words: ClassVar[int] = 0  # number of words of all fields
    number_words: ClassVar[dict[str, int]] = {}

    if TYPE_CHECKING:
        flat: Floats
        numbers: Any
        address: int

    def __init__(self, flat: Floats) -> None:
        own = {"flat": flat, "numbers": flat.data, "address": address(flat)}
        self.__dict__.update(own)

    def __setattr__(self, name: str, value: float) -> None:
        """Store a number; names of other kinds cannot be assigned."""
        word = self.number_words.get(name)
        if word is None:
            raise AttributeError("only numbers are stored; all else stays")
        self.numbers[word] = value

    def __init_subclass__(cls) -> None:
        """Assign a word to each annotated name."""
        cls.fields = dict(cls.fields)
        for name, kind in inspect.get_annotations(cls).items():
            given = cls.__dict__.get(name, 0.0)
            if isinstance(given, Field):
                field = given
            else:
                field = (Number if str(kind) == NUMBER else Field)(str(kind), given)
            if field.kind not in (NUMBER, SIZE) and field is not given:
                raise TypeError(f"{name}: float, int, or an array with its length")
            before = cls.fields.get(name)
            if before and not field.replaces and before.length != field.length:
                raise TypeError(f"{name}: a base class has another array of this name")
            field.word = before.word if before else cls.words
            if before is None:
                cls.words += 2 if field.kind in (ARRAY, BLOCK) else 1
            cls.fields[name], field.name = field, name
            setattr(cls, name, field)
        numbers = (x for x in cls.fields.values() if x.kind == NUMBER)
        cls.number_words = {field.name: field.word for field in numbers}

    @classmethod
    def allocate(cls, **sizes: int) -> Self:
        """Return a new memory of the given sizes; other sizes have their defaults.

        Raises
        ------
        TypeError
            If the class declares no size of a given name.
        """
        key = cls, *sizes.items()
        if key in _MADE:
            return cls(_MADE[key].copy())
        memory = cls._laid_out(sizes)
        if len(memory.flat) <= SMALL:
            _MADE[key] = memory.flat.copy()
        return memory

    @classmethod
    def _laid_out(cls, sizes: Mapping[str, int]) -> Self:
        import numpy as np

        end = cls.words
        memory = cls(np.zeros(end))
        if unknown := sizes.keys() - cls.fields.keys():
            raise TypeError(f"{cls.__name__} has no {', '.join(sorted(unknown))}")
        for name, field in cls.fields.items():
            if field.kind != ARRAY:
                memory.flat[field.word] = sizes.get(name, field.value)
        for field in cls.fields.values():
            if field.kind not in (ARRAY, BLOCK):
                continue
            length = memory.size_of(field.length)
            begin = field.within(memory) if field.within else end
            memory.flat[field.word : field.word + 2] = begin, length
            if not field.within:
                end += length
        more = np.zeros(end - cls.words)
        memory = cls(np.concatenate([memory.flat, more]))
        for name, field in cls.fields.items():
            if field.kind == ARRAY and field.value != 0.0:
                getattr(memory, name)[:] = field.value
        return memory

    def place(self, name: str) -> int:
        """Return the index in the flat array at which an array begins."""
        return int(self.numbers[self.fields[name].word])

    def place_after(self, name: str) -> int:
        """Return the index in the flat array at which an array ends, exclusive."""
        word = self.fields[name].word
        return int(self.numbers[word] + self.numbers[word + 1])

    def size_of(self, length: Length) -> int:
        """Return the number of components that a declared length denotes; 0 for "".

        length : the name of a size, or a function of the memory.
        """
        if callable(length):
            return length(self)
        return int(getattr(self, length)) if length else 0

    def copy(self) -> Self:
        """Return a new memory with equal content."""
        return type(self)(self.flat.copy())

    def take(self, other: Memory) -> None:
        """Copy numbers, and arrays of equal length, from the memory `other`.

        Names that only one of both memories has are left out.
        """
        for name in self.fields.keys() & other.fields.keys():
            field = self.fields[name]
            if field.kind == NUMBER:
                setattr(self, name, getattr(other, name))
            elif field.kind == ARRAY and not field.within:
                mine, its = getattr(self, name), getattr(other, name)
                if len(mine) == len(its):
                    mine[:] = its
