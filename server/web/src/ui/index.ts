export * from "./controls";
export * from "./layout";
export { Plot } from "./plot";
export type { PlotProps, PlotSeries } from "./plot";
export * as format from "./format";
