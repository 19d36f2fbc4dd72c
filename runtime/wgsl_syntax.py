"""The little of WGSL's grammar that the loader needs: comments, top-level declarations, imports, bindings."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

IMPORT = re.compile(r"^[ \t]*import\s+package::([\w:]+?)::(?:\{([^}]*)\}|(\w+))\s*;", re.MULTILINE)
ANY_IMPORT = re.compile(r"^[ \t]*import\b[^;]*;?", re.MULTILINE)
DECLARATION = re.compile(r"\b(fn|struct|alias|const|override|var(?:\s*<[^>]*>)?)\s+(\w+)")
CALL = re.compile(r"(?<![.@\w])([A-Za-z_]\w*)\s*\(")
RESOURCE = re.compile(
    r"((?:@\w+\s*(?:\([^)]*\))?\s*)+)var\s*(?:<\s*([^>]*?)\s*>)?\s*(\w+)\s*:\s*([^;]+?)\s*;"
)
OVERRIDE = re.compile(r"\boverride\s+(\w+)\s*(?::\s*(\w+)\s*)?(?:=\s*([^;]+?)\s*)?;")
CONST = re.compile(r"\bconst\s+(\w+)\s*(?::\s*\w+\s*)?=\s*([^;]+?)\s*;")
ENTRY_POINT = re.compile(r"@(compute|vertex|fragment)\b((?:\s*@\w+\s*(?:\([^)]*\))?)*)\s*fn\s+(\w+)")
WORKGROUP_SIZE = re.compile(r"@workgroup_size\s*\(([^)]*)\)")

TEXTURE_DIMENSIONS = {
    "1d": "1d",
    "2d": "2d",
    "2d_array": "2d-array",
    "3d": "3d",
    "cube": "cube",
    "cube_array": "cube-array",
}
SAMPLE_TYPES = {"f32": "float", "i32": "sint", "u32": "uint"}


@dataclass(frozen=True)
class Binding:
    """One `@group @binding` resource.

    kind: uniform, storage, texture, storage_texture or sampler.
    access: read, write or read_write, of storage buffers and storage textures.
    format: of storage textures.
    dimension, sample_type (float, unfilterable-float, sint, uint, depth): of textures.
    comparison: of samplers.
    line: in the spliced text.
    """

    group: int
    index: int
    name: str
    kind: str
    type: str
    access: str | None = None
    format: str | None = None
    dimension: str | None = None
    sample_type: str | None = None
    multisampled: bool = False
    comparison: bool = False
    line: int = 0


@dataclass(frozen=True)
class Override:
    """An `override` constant; `default` is its text, or None when a value must be given."""

    name: str
    type: str | None
    default: str | None


@dataclass(frozen=True)
class Import:
    """`import package::path::{names};` and the line on which it begins."""

    path: tuple[str, ...]
    names: tuple[str, ...]
    line: int


class SyntaxFault(ValueError):
    """What is wrong, and on which line of the text (1 is the first)."""

    def __init__(self, line: int, message: str) -> None:
        super().__init__(message)
        self.line = line


def blank(text: str) -> str:
    """Spaces of the same length, line ends kept, so that positions stay valid."""
    return re.sub(r"[^\n]", " ", text)


def without_comments(text: str) -> str:
    """The text with `//` and (nesting) `/* */` comments blanked."""
    out, position, depth, in_line = [], 0, 0, False
    for token in re.finditer(r"//|/\*|\*/|\n", text):
        chunk = text[position : token.start()]
        out.append(blank(chunk) if depth or in_line else chunk)
        position = token.end()
        if token[0] == "\n":
            in_line = False
        elif not in_line:
            depth += {"/*": 1, "*/": -1}.get(token[0], 0)
            in_line = token[0] == "//" and depth == 0
        out.append(blank(token[0]))
    out.append(blank(text[position:]) if depth or in_line else text[position:])
    return "".join(out)


def top_level(text: str) -> str:
    """The comment-free text with everything inside braces blanked."""
    out, depth = [], 0
    for character in text:
        if character == "}":
            depth -= 1
        out.append(character if depth == 0 or character == "\n" else " ")
        if character == "{":
            depth += 1
    return "".join(out)


def line_of(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1


def parse_imports(text: str) -> tuple[list[Import], str]:
    """The imports of a comment-free text, and the pattern's spans blanked out of it. Raises SyntaxFault."""
    imports = []
    for match in IMPORT.finditer(text):
        names = tuple(name.strip() for name in (match[2] or match[3]).split(",") if name.strip())
        line = line_of(text, match.start() + len(match[0]) - len(match[0].lstrip()))
        imports.append(Import(tuple(match[1].split("::")), names, line))
    rest = IMPORT.sub(lambda match: blank(match[0]), text)
    for match in ANY_IMPORT.finditer(top_level(rest)):
        line = line_of(rest, match.start())
        raise SyntaxFault(line, "an import reads `import package::folder::module::{name, name};`")
    return imports, rest


def declarations(text: str) -> dict[str, int]:
    """Line of each name that the comment-free text declares at its top level."""
    flat = top_level(text)
    return {match[2]: line_of(flat, match.start(2)) for match in DECLARATION.finditer(flat)}


def structs(text: str) -> Iterator[tuple[str, int, int]]:
    """Name, start and end position of each struct of a comment-free text."""
    for match in re.finditer(r"\bstruct\s+(\w+)\s*\{[^}]*\}", text):
        yield match[1], match.start(), match.end()


def parse_bindings(text: str) -> tuple[Binding, ...]:
    """Every resource of a comment-free text, by group and index. Raises SyntaxFault."""
    flat = top_level(text)
    found = []
    for match in RESOURCE.finditer(flat):
        attributes = dict(re.findall(r"@(\w+)\s*\(\s*([^)]*?)\s*\)", match[1]))
        if "group" not in attributes:
            continue
        line = line_of(flat, match.start(3))
        try:
            group, index = int(attributes["group"].rstrip("ui")), int(attributes["binding"].rstrip("ui"))
        except (KeyError, ValueError):
            raise SyntaxFault(line, f"{match[3]}: @group and @binding take plain numbers") from None
        found.append(_binding(group, index, match[3], match[2], match[4], line, text))
    return tuple(sorted(found, key=lambda binding: (binding.group, binding.index)))


def _binding(
    group: int, index: int, name: str, space: str | None, type_: str, line: int, text: str
) -> Binding:
    type_ = re.sub(r"\s+", "", type_)
    if space is not None:
        words = [word.strip() for word in space.split(",") if word.strip()]
        if words[0] == "uniform":
            return Binding(group, index, name, "uniform", type_, line=line)
        if words[0] == "storage":
            access = words[1] if len(words) > 1 else "read"
            return Binding(group, index, name, "storage", type_, access=access, line=line)
        raise SyntaxFault(line, f"{name}: var<{space}> is no resource")
    if type_ in ("sampler", "sampler_comparison"):
        return Binding(group, index, name, "sampler", type_, comparison=type_ != "sampler", line=line)
    if match := re.fullmatch(r"texture_storage_(\w+?)<(\w+),(\w+)>", type_):
        dimension = TEXTURE_DIMENSIONS[match[1]]
        return Binding(
            group,
            index,
            name,
            "storage_texture",
            type_,
            match[3],
            match[2].replace("_", "-"),
            dimension,
            line=line,
        )
    if match := re.fullmatch(r"texture_depth_(multisampled_)?(\w+)", type_):
        dimension = TEXTURE_DIMENSIONS[match[2]]
        return Binding(
            group, index, name, "texture", type_, None, None, dimension, "depth", bool(match[1]), line=line
        )
    if match := re.fullmatch(r"texture_(multisampled_)?(\w+?)<(\w+)>", type_):
        sample_type = SAMPLE_TYPES[match[3]]
        if sample_type == "float" and (match[1] or not is_filtered(name, text)):
            sample_type = "unfilterable-float"
        dimension = TEXTURE_DIMENSIONS[match[2]]
        return Binding(
            group,
            index,
            name,
            "texture",
            type_,
            None,
            None,
            dimension,
            sample_type,
            bool(match[1]),
            line=line,
        )
    raise SyntaxFault(line, f"{name}: {type_} cannot be bound")


def is_filtered(name: str, text: str) -> bool:
    """Whether a texture may meet a sampler: the text names it elsewhere than in textureLoad and size queries.

    A texture that is only loaded accepts every float format, filterable or not.
    """
    uses = len(re.findall(rf"(?<![.\w]){name}\b", text)) - 1  # less its declaration
    plain = len(
        re.findall(rf"\btexture(?:Load|Dimensions|NumLevels|NumLayers|NumSamples)\s*\(\s*{name}\b", text)
    )
    return uses > plain


def parse_overrides(text: str) -> tuple[Override, ...]:
    return tuple(Override(match[1], match[2], match[3]) for match in OVERRIDE.finditer(top_level(text)))


def parse_entry_points(text: str) -> dict[str, str]:
    """Stage (compute, vertex, fragment) -> function of a comment-free text. Raises SyntaxFault for two."""
    flat = top_level(text)
    found: dict[str, str] = {}
    for match in ENTRY_POINT.finditer(flat):
        if match[1] in found:
            line = line_of(flat, match.start(3))
            raise SyntaxFault(
                line, f"{match[3]}: the kernel has a @{match[1]} entry point, {found[match[1]]}"
            )
        found[match[1]] = match[3]
    return found


def parse_workgroup_size(text: str, constants: Mapping[str, float]) -> tuple[int, int, int] | None:
    """`@workgroup_size` with the values of its `override` and `const` names; None where there is none."""
    flat = top_level(text)
    match = WORKGROUP_SIZE.search(flat)
    if match is None:
        return None
    known: dict[str, str | float] = dict(CONST.findall(flat))
    known.update({entry.name: entry.default for entry in parse_overrides(text) if entry.default is not None})
    known.update(constants)
    try:
        sizes = [_evaluate(part, known) for part in match[1].split(",") if part.strip()]
    except (KeyError, SyntaxError, TypeError) as fault:
        raise SyntaxFault(
            line_of(flat, match.start()), f"@workgroup_size({match[1]}): unknown {fault}"
        ) from fault
    x, y, z = [*sizes, 1, 1][:3]
    return x, y, z


def _evaluate(expression: str, known: Mapping[str, str | float]) -> int:
    """An integer expression of literals, known names, + - * / and casts."""

    def value(node: ast.expr) -> int:
        match node:
            case ast.Constant(value=int() as number):
                return number
            case ast.Name(id=name):
                found = known[name]
                return _evaluate(found, known) if isinstance(found, str) else int(found)
            case ast.Call(func=ast.Name(id="u32" | "i32"), args=[argument]):
                return value(argument)
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                return value(left) + value(right)
            case ast.BinOp(left=left, op=ast.Sub(), right=right):
                return value(left) - value(right)
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                return value(left) * value(right)
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                return value(left) // value(right)
        raise TypeError(ast.unparse(node))

    plain = re.sub(r"\b(0x[0-9a-fA-F]+|\d+)[ui]\b", r"\1", expression.strip())
    return value(ast.parse(plain, mode="eval").body)
