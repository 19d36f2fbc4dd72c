"""Loads a kernel's WGSL: splices its imports, keeps a map back to the files, reads its bindings.

`import package::lib::sdf::{sd_box, sd_sphere};` (the import statement of WESL, https://wesl-lang.dev) splices
`shaders/lib/sdf.wgsl` whole and once, before the module that asks for it; the names are checked to exist
there. Modules share one name space, so a name is declared once in all the modules of a kernel.

`package::structs` holds the generated structs, of which only the named ones (and what they contain) are
spliced. An alias replaces the first part of a path: with `aliases={"technique": "sdfddgi"}`,
`package::technique::lookup` is `shaders/sdfddgi/lookup.wgsl`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from runtime import wgsl_syntax as syntax
from runtime.wgsl_syntax import Binding, Override

__all__ = ["SHADERS", "Binding", "Override", "Shader", "WgslError", "load"]

SHADERS = Path(__file__).parent / "shaders"
STRUCTS = ("structs",)

# The parts of naga's messages that name lines: "┌─ label:12:5", "12 │ code", "   │ ^^^ what".
PLACE = re.compile(r"┌─ \S*?:(\d+)(:\d+)")
GUTTER = re.compile(r"^\s*(\d+) │", re.MULTILINE)
MARKER = re.compile(r"^\s*│[ │]*\^")


class WgslError(ValueError):
    """A fault in a shader; the message begins with `file:line`."""


@dataclass(frozen=True)
class Shader:
    """A kernel's complete WGSL. `line_map[i]` is the (file, line) that line i + 1 of `code` came from."""

    name: str
    code: str
    line_map: tuple[tuple[Path, int], ...]
    bindings: tuple[Binding, ...]
    overrides: tuple[Override, ...]
    entry_points: Mapping[str, str]

    @cached_property
    def workgroup_size(self) -> tuple[int, int, int] | None:
        """Of the compute entry point, with the overrides' defaults."""
        return self.workgroup_size_with({})

    def workgroup_size_with(self, constants: Mapping[str, float]) -> tuple[int, int, int] | None:
        """Of the compute entry point, with these values for its overrides."""
        try:
            return syntax.parse_workgroup_size(syntax.without_comments(self.code), constants)
        except syntax.SyntaxFault as fault:
            raise WgslError(f"{self.locate(fault.line)}: {fault}") from fault

    def locate(self, line: int) -> str:
        """`file:line` of a line of `code`."""
        path, original = self.line_map[min(max(line, 1), len(self.line_map)) - 1]
        return f"{path}:{original}"

    def explain(self, message: str) -> str:
        """A compiler's message about `code` with the places of the original files in it."""
        fault = _faulty_line(message)
        text = PLACE.sub(lambda match: f"┌─ {self.locate(int(match[1]))}{match[2]}", message)
        text = GUTTER.sub(lambda match: f"{self.line_map[int(match[1]) - 1][1]:>{len(match[1])}} │", text)
        head = f"{self.locate(fault)}: " if fault else ""
        return f"{head}{self.name}: {text.strip()}"


def _faulty_line(message: str) -> int | None:
    """The line of `code` under which the compiler put its first marker, else the place that it names."""
    line = None
    for row in message.splitlines():
        if match := GUTTER.match(row):
            line = int(match[1])
        elif line is not None and MARKER.match(row):
            return line
    place = PLACE.search(message)
    return int(place[1]) if place else None


def load(name: str, aliases: Mapping[str, str] | None = None, root: Path = SHADERS) -> Shader:
    """The kernel `root/<name>.wgsl` with its imports. Raises WgslError naming file and line of a fault."""
    splicer = _Splicer(root, dict(aliases or {}))
    splicer.visit(tuple(name.split("/")), f"kernel {name}")
    return splicer.shader(name)


@dataclass
class _Module:
    path: Path
    text: str  # imports blanked, comments kept
    bare: str  # comments blanked too
    declared: dict[str, int]
    imported: set[str] = field(default_factory=set)


class _Splicer:
    """Walks the imports depth first and collects the modules in the order in which they are needed."""

    def __init__(self, root: Path, aliases: dict[str, str]) -> None:
        self.root = root
        self.aliases = aliases
        self.modules: dict[tuple[str, ...], _Module] = {}
        self.walking: list[tuple[str, ...]] = []
        self.wanted_structs: dict[str, str] = {}  # name -> place of the first import

    def visit(self, key: tuple[str, ...], asked_by: str) -> _Module:
        if key in self.walking:
            circle = " -> ".join("::".join(part) for part in [*self.walking[self.walking.index(key) :], key])
            raise WgslError(f"{asked_by}: imports run in a circle: {circle}")
        if key in self.modules:
            return self.modules[key]
        self.walking.append(key)
        path = self.root.joinpath(*key).with_suffix(".wgsl")
        text = self._read(path, key, asked_by)
        try:
            imports, bare = syntax.parse_imports(syntax.without_comments(text))
        except syntax.SyntaxFault as fault:
            raise WgslError(f"{path}:{fault.line}: {fault}") from fault
        module = _Module(path, _blank_imports(text), bare, syntax.declarations(bare))
        for statement in imports:
            self._resolve(statement, module)
        self.walking.pop()
        self.modules[key] = module
        return module

    def _read(self, path: Path, key: tuple[str, ...], asked_by: str) -> str:
        if not path.is_file():
            hint = f"; give aliases={{{key[0]!r}: ...}} where it is an alias" if len(key) > 1 else ""
            raise WgslError(f"{asked_by}: there is no module {path}{hint}")
        return path.read_text(encoding="utf-8")

    def _resolve(self, statement: syntax.Import, module: _Module) -> None:
        place = f"{module.path}:{statement.line}"
        module.imported.update(statement.names)
        first, *rest = statement.path
        key = (*self.aliases.get(first, first).split("/"), *rest)
        imported = self.visit(key, place)
        for name in statement.names:
            if name not in imported.declared:
                raise WgslError(f"{place}: {imported.path} declares no {name}")
            if key == STRUCTS:
                self.wanted_structs.setdefault(name, place)

    def shader(self, name: str) -> Shader:
        structs = self.modules.get(STRUCTS)
        if structs is not None:
            self.modules[STRUCTS] = _keep_structs(structs, self.wanted_structs)
        modules = list(self.modules.values())
        self._check_names(modules)
        lines: list[str] = []
        line_map: list[tuple[Path, int]] = []
        for module in modules:
            for number, line in enumerate(module.text.splitlines(), start=1):
                if line.strip():
                    lines.append(line)
                    line_map.append((module.path, number))
        code = "\n".join(lines) + "\n"
        return _read_shader(name, code, tuple(line_map))

    def _check_names(self, modules: list[_Module]) -> None:
        """Each name is declared once, and a module imports the functions that it calls."""
        owner: dict[str, _Module] = {}
        for module in modules:
            for name, line in module.declared.items():
                if name in owner:
                    other = owner[name]
                    raise WgslError(
                        f"{module.path}:{line}: {name} is declared in {other.path}:{other.declared[name]} too"
                    )
                owner[name] = module
        for module in modules:
            for match in syntax.CALL.finditer(module.bare):
                name = match[1]
                known = name in module.declared or name in module.imported or name not in owner
                if not known and owner[name].path.name != "structs.wgsl":
                    line = syntax.line_of(module.bare, match.start())
                    raise WgslError(
                        f"{module.path}:{line}: {name} of {owner[name].path} is called but not imported"
                    )


def _blank_imports(text: str) -> str:
    """The text with its import statements blanked, those inside comments kept."""
    bare = syntax.without_comments(text)
    out, start = [], 0
    for match in syntax.IMPORT.finditer(bare):
        out += [text[start : match.start()], syntax.blank(match[0])]
        start = match.end()
    return "".join([*out, text[start:]])


def _keep_structs(module: _Module, wanted: Iterable[str]) -> _Module:
    """The module with only the wanted structs and those that they contain."""
    spans = {name: (start, end) for name, start, end in syntax.structs(module.bare)}
    keep: set[str] = set()
    todo = list(wanted)
    while todo:
        name = todo.pop()
        if name in spans and name not in keep:
            keep.add(name)
            start, end = spans[name]
            todo += [word for word in re.findall(r"\w+", module.bare[start:end]) if word != name]
    text = list(syntax.blank(module.text))
    for start, end in sorted(spans[name] for name in keep):
        text[start:end] = module.text[start:end]
    kept = "".join(text)
    bare = syntax.without_comments(kept)
    return _Module(module.path, kept, bare, syntax.declarations(bare), module.imported)


def _read_shader(name: str, code: str, line_map: tuple[tuple[Path, int], ...]) -> Shader:
    bare = syntax.without_comments(code)

    def place(line: int) -> str:
        path, original = line_map[line - 1]
        return f"{path}:{original}"

    try:
        bindings = syntax.parse_bindings(bare)
        entry_points = syntax.parse_entry_points(bare)
    except syntax.SyntaxFault as fault:
        raise WgslError(f"{place(fault.line)}: {fault}") from fault
    slots: dict[tuple[int, int], Binding] = {}
    for binding in bindings:
        other = slots.setdefault((binding.group, binding.index), binding)
        if other is not binding:
            slot = f"@group({binding.group}) @binding({binding.index})"
            raise WgslError(
                f"{place(binding.line)}: {binding.name} takes {slot} of {other.name} in {place(other.line)}"
            )
    return Shader(name, code, line_map, bindings, syntax.parse_overrides(bare), entry_points)
