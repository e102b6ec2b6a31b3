# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Results of a contact as functions of the slave bodies."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import cpp
from .interfaces import Interface


class ContactFields(Interface):
    """What a contact has to show besides the multiplier."""

    _columns = {
        **Interface._columns,
        "pressure": 1,
        "gap": 1,
        "status": 1,
        "slip": 3,
        "tangential_traction": 3,
    }

    _geometry: str
    _status: npt.NDArray[np.int8]
    _total_slip: npt.NDArray[np.float64]

    def _nodal_gap(self) -> npt.NDArray[np.float64]:
        raise NotImplementedError

    def _scatter(self, owned: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        values = np.zeros((self.num_nodes, owned.shape[1]))
        values[: self.num_owned] = owned
        cpp.scatter_forward(self._surface_slave, values)
        return values

    def _distances(self) -> npt.NDArray[np.float64]:
        """Gap of the owned nodes [length] as the field shows it; zero without a multiplier."""
        gap = self._nodal_gap()
        gap = np.where(np.isfinite(gap), gap, 0.0)
        if self._geometry == "reference":
            return gap
        # Far away the negative parts of the multiplier's functions would feign penetration
        n = self.num_owned
        far = (self._data.carries[:n] != 0) & (self._nodal["near"][:n] == 0)
        far &= self._status == 0
        return np.where(far, self._nodal["distance"][:n], gap)

    def _update_fields(self) -> None:
        """Let the fields show the present state. Collective."""
        if not self._owner()._started:
            self._fields.clear()
            return
        super()._update_fields()
        status = self._status.astype(np.float64)
        normals = self._configuration.normals
        z = self._z()
        pressure = np.sum(z * normals, axis=1)[:, None]
        distances = self._distances()
        self._set_field("pressure", pressure, "largest")
        self._set_field("tangential_traction", pressure * normals - z, "mean", self._shares())
        self._set_field("gap", self._scatter(distances[:, None]), "smallest")
        self._set_field("slip", self._scatter(self._total_slip), "first", status)
        self._fields.set("status", status[:, None], "largest")

    @property
    def pressure(self) -> fem.Function:
        """Contact pressure n·λ [traction], positive in compression; see :attr:`multiplier`.

        At an edge, where a node has a normal and a pressure on each side, the largest.
        """
        return self._field("pressure")

    @property
    def tangential_traction(self) -> fem.Function:
        """Tangential part of the contact traction on the slave body."""
        return self._field("tangential_traction")

    @property
    def gap(self) -> fem.Function:
        """Distance of the master along the slave's normals [length].

        Near the master an average around each node with the multiplier's functions, as in the
        contact condition; further away the mean gap of the facets around. Nodes that carry no
        multiplier have the mean of their neighbours, zero where these carry none either, as out
        of reach of the search. At an edge the smallest.
        """
        return self._field("gap")

    @property
    def slip(self) -> fem.Function:
        """Tangential slip [length] of slave nodes in contact since contact began."""
        return self._field("slip")

    @property
    def status(self) -> fem.Function:
        """0 open, 1 stick, 2 slip (frictionless contact: always 2); at an edge the largest."""
        return self._field("status")
