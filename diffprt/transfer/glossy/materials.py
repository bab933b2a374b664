"""The BRDFs of a scene as glossy transfer uses them: tables, one per BRDF, and which receiver has which."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from diffprt import sh
from diffprt.brdf import Brdf, Lambert, fitted_matrix
from diffprt.errors import InputError
from diffprt.scene import Scene
from diffprt.sh.product import triple_products
from diffprt.transfer.glossy.visibility_matrix import visibility_order


def brdfs_of(scene: Scene) -> list[Brdf]:
    """The BRDF that all materials share, or one per material; a material without one is Lambertian with its albedo.

    Raises:
        InputError: a material without a BRDF whose albedo varies over its surface.
    """
    first = scene.materials[0].brdf
    if first is not None and all(material.brdf is first for material in scene.materials):
        return [first]
    for mesh in scene.meshes:
        material = scene.materials[mesh.material]
        varies = material.albedo_texture is not None or mesh.colors is not None
        if material.brdf is None and varies and not mesh.occluder_only:
            raise InputError(
                f"material '{material.name}' has a texture or vertex colors and stands beside BRDFs: glossy transfer "
                "holds one reflectance per material, give it a BRDF or an albedo of one value"
            )
    return [_lambert(m.albedo) if m.brdf is None else m.brdf for m in scene.materials]


def _lambert(albedo: torch.Tensor) -> Lambert:
    """Gray where the albedo is: colors would triple the signal."""
    gray = not albedo.requires_grad and bool((albedo == albedo[0]).all())
    return Lambert(diffuse=albedo[0] if gray else albedo)


@dataclass(frozen=True)
class GlossyMaterials:
    """Tables of every BRDF.

    Attributes:
        reflection: float64 [M, C, K_out, K_out], coefficients of each BRDF above the surface, without cosine. The
            incident side has as many bands as the exit side: lobes hardly mix bands.
        shading: float64 [M, C, K_out, K, K_v]: times the visibility of a receiver it is its transfer without bounces,
            on its own axes: Σ_i reflection[o, i] ∫ y_i y_j y_k.
        of_receiver: int64 [V], BRDF of each receiver.
    """

    reflection: torch.Tensor
    shading: torch.Tensor
    of_receiver: torch.Tensor

    @staticmethod
    def of(scene: Scene, order: int, order_out: int, ridge: float) -> GlossyMaterials:
        """Tables of the scene's BRDFs."""
        brdfs = brdfs_of(scene)
        channels = max(b.channels for b in brdfs)
        fits = [fitted_matrix(b, order_out, order_out, ridge=ridge).expand(channels, -1, -1) for b in brdfs]
        reflection = torch.stack(fits)
        products = triple_products(order_out, order, visibility_order(order_out, order))
        shading = torch.einsum("mcoi,ijk->mcojk", reflection, products)
        shown = [mesh for mesh in scene.meshes if not mesh.occluder_only]
        counts = torch.tensor([len(mesh.positions) for mesh in shown])
        index = torch.tensor([mesh.material if len(brdfs) > 1 else 0 for mesh in shown])
        return GlossyMaterials(reflection, shading, index.repeat_interleave(counts))

    def reordered(self, order: torch.Tensor) -> GlossyMaterials:
        """The same tables for receivers in another `order`, int64 [V]."""
        return replace(self, of_receiver=self.of_receiver[order])

    @property
    def order_out(self) -> int:
        """SH bands of exit radiance."""
        return sh.order_of_count(self.reflection.shape[2])

    def shade(self, visibility: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
        """Transfer [R, C, K_out, K] on the receivers' own axes, from `visibility` [R, K_v] and BRDFs `index` [R]."""
        return self._by_material(visibility, index, self.shading.flatten(1, 3), self.shading.shape[1:4])

    def reflect(self, incoming: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
        """Exit coefficients [N, C, K_out] of light from one direction of the upper hemisphere, per steradian.

        Args:
            incoming: [N, 3], on the receivers' own axes.
            index: int64 [N], BRDFs.
        """
        rows = sh.basis(incoming, self.order_out).to(self.reflection.dtype)
        return self._by_material(rows, index, self.reflection.flatten(1, 2), self.reflection.shape[1:3])

    def _by_material(
        self, rows: torch.Tensor, index: torch.Tensor, tables: torch.Tensor, shape: torch.Size
    ) -> torch.Tensor:
        """tables[index] @ rows, unflattened to [N, *shape]."""
        if len(tables) == 1:
            return (rows @ tables[0].T).unflatten(1, shape)
        out = rows.new_zeros(len(rows), tables.shape[1])
        for material in index.unique().tolist():
            own = torch.nonzero(index == material)[:, 0]
            out = out.index_copy(0, own, rows[own] @ tables[material].T)
        return out.unflatten(1, shape)
