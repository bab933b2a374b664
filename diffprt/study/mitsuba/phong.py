"""Phong's BRDFs for Mitsuba, which has none: his own of 1975 and the energy-conserving one (`diffprt.brdf.phong`).

Written again from the formulas, in Mitsuba's terms, and sampled by its own code: a peer shares nothing with what it
checks.
"""

from __future__ import annotations

from functools import lru_cache
from types import ModuleType

from diffprt.brdf import Phong

_NAME = "diffprt_phong"


def phong_bsdf(mitsuba: ModuleType, brdf: Phong) -> dict:
    """The description of `Phong` or `ModifiedPhong` for `mitsuba.load_dict`."""
    _register(mitsuba, mitsuba.variant())
    colors = {key: getattr(brdf, key).detach().double().expand(3).tolist() for key in ("diffuse", "specular")}
    return {
        "type": _NAME,
        "exponent": float(brdf.exponent.detach()),
        "original": type(brdf) is Phong,
        **{key: {"type": "rgb", "value": value} for key, value in colors.items()},
    }


@lru_cache(maxsize=4)
def _register(mitsuba: ModuleType, variant: str) -> None:
    """Makes the class known to Mitsuba, once for each variant."""
    import drjit

    class MitsubaPhong(mitsuba.BSDF):
        """diffuse / π + specular (n+2)/2π cosⁿα; in the original (n+1)/2π, and divided by the light's cosine."""

        def __init__(self, properties):
            super().__init__(properties)
            self.exponent, self.original = properties["exponent"], properties["original"]
            self.diffuse, self.specular = (mitsuba.Color3f(properties[key]) for key in ("diffuse", "specular"))
            # Probability of sampling the lobe.
            diffuse, specular = (sum(properties[key]) for key in ("diffuse", "specular"))
            self.share = specular / (diffuse + specular) if specular > 0 else 0.0
            flags = mitsuba.BSDFFlags.GlossyReflection | mitsuba.BSDFFlags.FrontSide
            self.m_components, self.m_flags = [flags], flags

        def power(self, interaction, direction):
            mirror = mitsuba.Vector3f(-interaction.wi.x, -interaction.wi.y, interaction.wi.z)
            return drjit.power(drjit.maximum(drjit.dot(mirror, direction), 0), self.exponent)

        def sample(self, context, interaction, first, second, active=True):
            mirror = mitsuba.Vector3f(-interaction.wi.x, -interaction.wi.y, interaction.wi.z)
            cosine = drjit.power(1 - second.x, 1 / (self.exponent + 1))
            sine, angle = drjit.safe_sqrt(1 - cosine * cosine), 2 * drjit.pi * second.y
            local = mitsuba.Vector3f(sine * drjit.cos(angle), sine * drjit.sin(angle), cosine)
            lobe, even = mitsuba.Frame3f(mirror).to_world(local), mitsuba.warp.square_to_cosine_hemisphere(second)
            sampled = mitsuba.BSDFSample3f()
            sampled.wo = drjit.select(first < self.share, lobe, even)
            sampled.pdf = self.pdf(context, interaction, sampled.wo, active)
            sampled.eta = 1.0
            sampled.sampled_type = mitsuba.UInt32(+mitsuba.BSDFFlags.GlossyReflection)
            sampled.sampled_component = mitsuba.UInt32(0)
            value = self.eval(context, interaction, sampled.wo, active)
            return sampled, drjit.select(sampled.pdf > 0, value / sampled.pdf, 0.0)

        def eval(self, context, interaction, direction, active=True):
            cosine, power = direction.z, self.power(interaction, direction)
            factor = (self.exponent + 1) if self.original else (self.exponent + 2) * cosine
            value = self.diffuse / drjit.pi * cosine + self.specular * (factor / (2 * drjit.pi) * power)
            return drjit.select((cosine > 0) & (interaction.wi.z > 0), value, 0.0)

        def pdf(self, context, interaction, direction, active=True):
            lobe = (self.exponent + 1) / (2 * drjit.pi) * self.power(interaction, direction)
            density = self.share * lobe + (1 - self.share) * drjit.maximum(direction.z, 0) / drjit.pi
            return drjit.select((direction.z > 0) & (interaction.wi.z > 0), density, 0.0)

        def eval_pdf(self, context, interaction, direction, active=True):
            value = self.eval(context, interaction, direction, active)
            return value, self.pdf(context, interaction, direction, active)

        def traverse(self, callback):
            pass

        def parameters_changed(self, keys=()):
            pass

        def to_string(self):
            return f"MitsubaPhong[exponent={self.exponent}, original={self.original}]"

    mitsuba.register_bsdf(_NAME, MitsubaPhong)
