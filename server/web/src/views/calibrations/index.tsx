/** Calibrations of the machine that is looked at, or two of them side by side. */
import { useRoute } from "../../routes";
import { CalibrationList } from "./list";
import { Compare } from "./compare";
import "./calibrations.css";

export default function CalibrationsView() {
  const [, what, a, b] = useRoute().path;
  return what === "compare" && a !== undefined && b !== undefined ? (
    <Compare key={`${a} ${b}`} a={a} b={b} />
  ) : (
    <CalibrationList />
  );
}
