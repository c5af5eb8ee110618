// The order in which a symmetric sparse matrix is eliminated, so that little fills in.
#pragma once
#include <vector>

namespace bt {

// The neighbours of every node of a graph, in one array: those of i from first[i] on to first[i + 1].
struct Adjacency {
  std::vector<int> first{0}, nodes;
  int count() const { return static_cast<int>(first.size()) - 1; }
};

// Approximate minimum degree (Amestoy, Davis and Duff 1996). The order is a function of the graph and nothing
// else. The arrays are kept from call to call.
class MinimumDegree {
 public:
  // Neighbours are listed both ways, once each, and no node is its own. Valid until the next call.
  const std::vector<int>& order(const Adjacency& graph);

 private:
  void start(const Adjacency& graph);
  int lightest();
  void make_element(int p);
  void take(int p, int from, int to);
  void measure_elements(int p);
  void update(int p, int i);
  void merge_twins(int p);
  bool twins(int i, int j);
  void join(int i, int into);
  void finish_element(int p);
  void link(int i);
  void unlink(int i);
  void write_order();
  int fresh_stamp() { return ++stamp_; }

  int n_ = 0, left_ = 0, least_ = 0, stamp_ = 0, found_ = 0;
  // Of a variable: first its elements, then its variables. Of an element: the variables that it joins.
  std::vector<int> lists_;
  std::vector<int> start_, length_, elements_;  // where those are, how many, how many are elements
  std::vector<int> weight_;          // nodes that a variable stands for; 0 once it is none any more
  std::vector<int> degree_;          // of a variable at most; of an element its nodes
  std::vector<char> alive_;          // elements
  std::vector<int> outside_, seen_;  // |L_e \ L_p|, and the stamp for which that is
  std::vector<int> mark_;
  std::vector<int> head_, next_, previous_;  // variables by degree
  std::vector<int> hash_head_, hash_next_, hash_of_;
  std::vector<int> last_, follower_;  // the nodes of a variable, one after the other
  std::vector<int> pivots_, order_;
};

}  // namespace bt
