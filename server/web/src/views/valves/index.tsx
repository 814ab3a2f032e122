/** Valves: all identifications of the machine's valves, or one of them. */
import { useRoute } from "../../routes";
import { ValveList } from "./list";
import { ValvePage } from "./result";
import "./valves.css";

export default function ValvesView() {
  const [, id] = useRoute().path;
  return id === undefined ? <ValveList /> : <ValvePage key={id} id={id} />;
}
