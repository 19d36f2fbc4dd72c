"""Bind group layouts and bind groups, made once and shared by all kernels that bind the same things alike."""

from __future__ import annotations

import weakref
from typing import Any


class BindGroups:
    """Caches per device. A bind group is dropped when one of the resources in it is."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self._layouts: dict[str, Any] = {}
        self._groups: dict[tuple[int, ...], Any] = {}

    def layout(self, entries: list[dict[str, Any]]) -> Any:
        """The layout with these entries."""
        key = repr(entries)
        if key not in self._layouts:
            self._layouts[key] = self._device.create_bind_group_layout(entries=entries)
        return self._layouts[key]

    def group(self, layout: Any, slots: tuple[int, ...], resources: tuple[Any, ...]) -> Any:
        """The bind group that holds `resources[i]` in binding `slots[i]`."""
        key = (layout.uid, *(resource.uid for resource in resources))
        group = self._groups.get(key)
        if group is None:
            entries = [
                {"binding": slot, "resource": resource.binding}
                for slot, resource in zip(slots, resources, strict=True)
            ]
            group = self._groups[key] = self._device.create_bind_group(layout=layout, entries=entries)
            for resource in resources:
                weakref.finalize(resource, self._groups.pop, key, None).atexit = False
        return group

    def __len__(self) -> int:
        return len(self._groups)
