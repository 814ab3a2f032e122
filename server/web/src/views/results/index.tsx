/** Results: all identifications of the machine, or one of them. */
import { useRoute } from "../../routes";
import { ResultList } from "./list";
import { ResultPage } from "./result";
import "./results.css";

export default function ResultsView() {
  const [, id] = useRoute().path;
  return id === undefined ? <ResultList /> : <ResultPage key={id} id={id} />;
}
