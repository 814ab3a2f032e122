/** Machines: all that the service knows, or the file of one of them. */
import { useRoute } from "../../routes";
import { MachinePage } from "./machine";
import { MachineList } from "./list";
import "./machines.css";
import { NewMachine } from "./new_machine";

export default function MachinesView() {
  const { path, query } = useRoute();
  const name = path[1];
  if (name !== undefined) return <MachinePage key={name} name={name} />;
  return query.new === undefined ? <MachineList /> : <NewMachine />;
}
