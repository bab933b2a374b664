// One entry per kind of asset (its twin is diffprt/export/representations.py): a class that uploads an asset, takes
// lights and draws. A new kind is a program in diffprt/export/shading, such a class and an entry here.
//
//   new Kind(gl, { numbers, arrays })
//   .paths                        ways to draw the same picture, the usual one first
//   .setLight(light [K * 3])      already turned; may draw into targets of its own
//   .draw(shared, target, path)   shared: uniforms of every program; target: { framebuffer, width, height }
import { ClusteredDiffuse, Diffuse, Unshadowed } from "./diffuse.js";
import { ClusteredGlossy, PlainGlossy } from "./glossy.js";

export const REPRESENTATIONS = {
  diffuse: Diffuse,
  unshadowed: Unshadowed,
  clustered_diffuse: ClusteredDiffuse,
  glossy: PlainGlossy,
  clustered_glossy: ClusteredGlossy,
};
