// The page classes, by the names that diffprt/exporters/packers give them: each uploads an asset, takes lights and
// draws. A new one is a program in diffprt/exporters/shaders/programs, such a class and an entry here.
//
//   new Class(gl, { numbers, arrays })
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
