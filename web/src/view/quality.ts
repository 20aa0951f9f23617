/** How much is drawn: `plain` without shadows and reflections, `full` with them. */
export type Quality = "plain" | "full";

const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;

/**
 * The quality that an address asks for by `?fast` or `?fine`; otherwise plain where no graphics processor draws,
 * which takes ten times as long.
 */
export function qualityFor(search: string): Quality {
  const asked = new URLSearchParams(search);
  if (asked.has("fast")) return "plain";
  if (asked.has("fine")) return "full";
  return SOFTWARE.test(rendererName()) ? "plain" : "full";
}

/** Name of what draws, or nothing if the browser does not tell. */
function rendererName(): string {
  const context = document.createElement("canvas").getContext("webgl2");
  if (context === null) return "";
  const details = context.getExtension("WEBGL_debug_renderer_info");
  const name = details === null ? "" : String(context.getParameter(details.UNMASKED_RENDERER_WEBGL));
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}
